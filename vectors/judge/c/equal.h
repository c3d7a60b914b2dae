/* Whether an answer has what a case expects. */
#include <ctype.h>
#include <math.h>

/* The text without blanks and in upper case; all that is not a digit of `only` makes it NULL. */
static char *plain(const json *value, const char *only) {
    char *text = keep(value->length + 1), *to = text;
    for (size_t place = 0; place < value->length; place++) {
        char byte = value->text[place];
        if (only && (!byte || !strchr(only, byte)))
            return NULL;
        if (byte != ' ')
            *to++ = (char)toupper((unsigned char)byte);
    }
    return text;
}

static bool are_same_digits(const json *wanted, const json *answered) {
    char *one = plain(wanted, "0123456789ABCDEFabcdef "), *other = plain(answered, "0123456789ABCDEFabcdef ");
    return one && other && !strcmp(one, other);
}

/* A decimal number as its digits without zeros at both ends and the exponent of the last one; NULL: it is none. */
static char *canonical(const json *value) {
    const char *at = value->text + strspn(value->text, "+-"), *point = NULL;
    char *digits = keep(value->length + 32), *to = digits;
    long exponent = 0;
    if (at - value->text > 1 || strlen(value->text) != value->length || !isdigit((unsigned char)*at))
        return NULL;
    for (; isdigit((unsigned char)*at) || (*at == '.' && !point && isdigit((unsigned char)at[1])); at++)
        if (*at == '.')
            point = at + 1;
        else
            *to++ = *at;
    exponent -= point ? at - point : 0;
    if (*at == 'e' || *at == 'E') {
        size_t sign = at[1] == '+' || at[1] == '-', count = strspn(at + 1 + sign, "0123456789");
        exponent += count ? atol(at + 1) : 0;
        at += count && count < 5 ? 1 + sign + count : 0;
    }
    for (; to > digits && to[-1] == '0'; exponent++)
        to--;
    *to = 0;
    char *first = digits + strspn(digits, "0");
    sprintf(to, *first ? "%se%ld" : "", value->text[0] == '-' ? "-" : "", exponent);
    return *at ? NULL : first;
}

/* The nearest number of the type; false: the text is none, or is too large. */
static bool nearest(const json *value, const json *type, double *number) {
    char *text = plain(value, NULL), *name = text + (*text == '-' || *text == '+');
    bool is_named = !strcmp(name, "INF") || !strcmp(name, "NAN");
    if (!(is_named || canonical(value)) || strlen(text) != value->length)
        return false;
    *number = is_text(type, "f32") ? (double)(float)strtod(text, NULL) : strtod(text, NULL);
    return is_named || isfinite(*number);
}

static bool are_same_numbers(const json *wanted, const json *answered, const json *type) {
    if (type->form == TEXT && *type->text == 'f') {
        double one, other;
        if (!nearest(wanted, type, &one) || !nearest(answered, type, &other))
            return false;
        return (isnan(one) && isnan(other)) || (one == other && signbit(one) == signbit(other));
    }
    if (type->form != TEXT || !*type->text || !strchr("uib", *type->text))
        return false;
    char *one = canonical(wanted), *other = canonical(answered);
    return one && other && !strcmp(one, other);
}

/* Bits of a response that was decoded without its request have up to seven more, all zero. */
static bool is_padded(const json *name, const json *wanted, const json *answered, const json *question) {
    bool is_response = is_text(get(question, "kind"), "pdu") && is_text(get(question, "side"), "response");
    if (!is_text(name, "bits") || !is_response || wanted->form != TEXT || answered->form != TEXT)
        return false;
    char *one = plain(wanted, NULL), *other = plain(answered, NULL);
    size_t length = strlen(one), zeros = strncmp(one, other, length) ? 8 : strspn(other + length, "0");
    return zeros < 8 && !other[length + zeros] && strlen(answered->text) == answered->length;
}

/* The identifier of a frame, or of the first of one_of; -1: it is none. */
static long identifier(const json *item) {
    const json *choices = get(item, "one_of"), *frame = choices->form == LIST && choices->length ? &choices->items[0] : item;
    const char *mark = frame->form == TEXT ? strchr(frame->text, '#') : NULL;
    return mark ? strtol(frame->text, NULL, 16) : -1;
}

/* Frames in the order of their identifiers, those of one identifier as they came; other lists unchanged. */
static const json **by_identifier(const json *list) {
    const json **sorted = keep(list->length * sizeof *sorted);
    bool are_frames = true;
    for (size_t place = 0; place < list->length; place++)
        are_frames &= identifier(&list->items[place]) >= 0;
    for (size_t place = 0, to; place < list->length; place++) {
        const json *item = &list->items[place];
        for (to = place; are_frames && to > 0 && identifier(sorted[to - 1]) > identifier(item); to--)
            sorted[to] = sorted[to - 1];
        sorted[to] = item;
    }
    return sorted;
}

/* Whether an answer has what is wanted. `name` is that of the field, `type` that of a number in it. */
static bool equal(const json *wanted, const json *answered, const json *name, const json *type, const json *question) {
    const json *choices = get(wanted, "one_of"), *from = get(wanted, "from"), *to = get(wanted, "to"), *kind = get(question, "kind");
    for (size_t place = 0; choices->form == LIST && place < choices->length; place++)
        if (equal(&choices->items[place], answered, name, type, question))
            return true;
    if (from->form == NUMBER && to->form == NUMBER)
        return answered->form == NUMBER && from->number <= answered->number && answered->number <= to->number &&
               floor(answered->number) == answered->number;
    if (choices->form == LIST || wanted->form != answered->form)
        return false;
    if (wanted->form == OBJECT) {
        for (size_t place = 0; place < wanted->length; place++) {
            const json *key = &wanted->names[place], *value = &wanted->items[place], *found = field(answered, key);
            if (found->form == MISSING || !(is_padded(key, value, found, question) || equal(value, found, key, type, question)))
                return false;
        }
        return true;
    }
    if (wanted->form == LIST) {
        bool any_order = is_text(kind, "device") || is_text(kind, "gateway-309-3"), same = wanted->length == answered->length;
        const json *entries = is_text(kind, "pdo") ? get(question, "entries") : &missing;
        const json **left = any_order ? by_identifier(wanted) : NULL, **right = any_order ? by_identifier(answered) : NULL;
        for (size_t place = 0; same && place < wanted->length; place++)
            same = equal(left ? left[place] : &wanted->items[place], right ? right[place] : &answered->items[place], name,
                         place < entries->length ? get(&entries->items[place], "type") : type, question);
        return same;
    }
    if (wanted->form != TEXT)
        return wanted->number == answered->number;
    if (is_text(kind, "device") && strstr(wanted->text, ".."))
        return fits_frame(wanted->text, wanted->length, answered->text, answered->length);
    bool is_number = is_text(name, "value") && are_same_numbers(wanted, answered, type);
    return are_same_texts(wanted, answered) || are_same_digits(wanted, answered) || is_number;
}
