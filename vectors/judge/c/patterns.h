/* Whether what a running server or device sent is accepted: patterns of server-conformance and device-conformance. */

static bool is_byte_like(const char *wanted, size_t size, const char *found, size_t found_size) {
    bool is_any = size >= 2 && !strncmp(wanted, "..", 2) && strspn(wanted + 2, ";") == size - 2;
    return is_any || (size == found_size && !strncmp(wanted, found, size));
}

/* One answer: in the pattern .. is any byte, ... any rest. */
static bool is_answer_like(const char *pattern, const char *text) {
    while (true) {
        pattern += strspn(pattern, " "), text += strspn(text, " ");
        size_t wanted = strcspn(pattern, " "), found = strcspn(text, " ");
        if (wanted == 3 && !strncmp(pattern, "...", 3) && !pattern[3 + strspn(pattern + 3, " ")])
            return true;
        if (!wanted || !found)
            return wanted == found;
        if (!is_byte_like(pattern, wanted, text, found))
            return false;
        pattern += wanted, text += found;
    }
}

/* server-conformance: one of the rows has a fitting text for each step. */
static bool fits_one_row(const json *rows, const json *texts) {
    for (size_t place = 0; place < texts->length; place++)
        if (texts->form != LIST || texts->items[place].form != TEXT)
            return false;
    for (size_t row = 0; row < rows->length && texts->form == LIST; row++) {
        const json *wanted = &rows->items[row];
        size_t place = 0;
        while (wanted->length == texts->length && place < wanted->length &&
               is_answer_like(wanted->items[place].text, texts->items[place].text))
            place++;
        if (place == wanted->length && wanted->length == texts->length)
            return true;
    }
    return false;
}

/* One frame: in the pattern a dot is any digit, [26] one of these, (?!3930) not these, | separates alternatives. */
static bool fits_frame(const char *pattern, size_t size, const char *text, size_t length) {
    const char *end = pattern + size, *bar = memchr(pattern, '|', size), *stop = text + length;
    if (bar && fits_frame(bar + 1, (size_t)(end - bar - 1), text, length))
        return true;
    for (end = bar ? bar : end; pattern < end; pattern++) {
        if (end - pattern > 3 && !strncmp(pattern, "(?!", 3)) {
            const char *digits = pattern + 3;
            size_t count = strcspn(digits, ")");
            if ((size_t)(stop - text) >= count && !strncmp(text, digits, count))
                return false;
            pattern = digits + count;
            continue;
        }
        if (text == stop)
            return false;
        bool is_like = *pattern == '.' ? *text && strchr("0123456789ABCDEF", *text) : *pattern == *text;
        if (*pattern == '[')
            for (is_like = false; *++pattern != ']';)
                is_like |= pattern[1] == '-' ? pattern[0] <= *text && *text <= pattern[2] : *pattern == *text;
        if (!is_like)
            return false;
        text++;
    }
    return text == stop;
}

/* The frames from `place` on: parts of a pattern with commas between; {0,3} behind one says how often it may come. */
static bool fits_frames(const char *pattern, const json *frames, size_t place) {
    pattern += strspn(pattern, ", ");
    if (!*pattern)
        return place == frames->length;
    size_t size = strcspn(pattern, "{,"), least = 1, most = 1;
    const char *rest = pattern + size;
    if (*rest == '{') {
        char *end;
        least = strtoul(rest + 1, &end, 10), most = strtoul(end + 1, &end, 10);
        rest = end + 1;
    }
    for (size_t count = 0; count <= most; count++, place++) {
        if (count >= least && fits_frames(rest, frames, place))
            return true;
        if (place >= frames->length || frames->items[place].form != TEXT ||
            !fits_frame(pattern, size, frames->items[place].text, frames->items[place].length))
            return false;
    }
    return false;
}

static bool fits_any(const json *patterns, const json *frames) {
    for (size_t place = 0; place < patterns->length; place++)
        if (fits_frames(patterns->items[place].text, frames, 0))
            return true;
    return false;
}

/* device-conformance: the frames of each step fit a pattern of `accept`; one of `ends` ends the case. */
static bool is_accepted(const json *steps, const json *received) {
    if (steps->form != LIST || !steps->length || received->form != LIST)
        return false;
    for (size_t place = 0; place < received->length; place++)
        if (received->items[place].form != LIST)
            return false;
    for (size_t place = 0; place < steps->length; place++) {
        const json *step = &steps->items[place];
        if (place >= received->length)
            return false;
        if (fits_any(get(step, "ends"), &received->items[place]))
            return received->length == place + 1;
        if (!fits_any(get(step, "accept"), &received->items[place]))
            return false;
    }
    return received->length == steps->length;
}
