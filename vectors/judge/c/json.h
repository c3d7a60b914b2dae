/* JSON for judge.c: parse() returns a tree, which lives until json_free() frees all trees at once. Texts are UTF-8, with
 * their length, since a text may hold U+0000. Of a name that comes twice the last one counts. */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum form { MISSING, NONE, BOOLEAN, NUMBER, TEXT, LIST, OBJECT };

typedef struct json {
    enum form form;
    double number; /* of BOOLEAN 0 or 1 */
    char *text;    /* ends with a further byte 0 */
    size_t length; /* of a text in bytes, otherwise the number of items */
    struct json *items, *names;
} json;

static const json missing = {MISSING, 0, "", 0, NULL, NULL};
static void **kept;
static size_t kept_count, kept_room;

static void *keep(size_t size) {
    if (kept_count == kept_room)
        kept = realloc(kept, (kept_room = kept_room * 2 + 64) * sizeof *kept);
    void *memory = calloc(1, size ? size : 1);
    if (!kept || !memory) {
        fputs("judge: no memory\n", stderr);
        exit(1);
    }
    return kept[kept_count++] = memory;
}

static void json_free(void) {
    while (kept_count)
        free(kept[--kept_count]);
}

static const char *json_at; /* where parse() is */
static bool parse_value(json *into, int depth);

static void skip_blanks(void) {
    while (*json_at && strchr(" \t\r\n", *json_at))
        json_at++;
}

static bool parse_word(const char *word) {
    size_t length = strlen(word);
    if (strncmp(json_at, word, length))
        return false;
    json_at += length;
    return true;
}

static bool parse_hex(unsigned *code) {
    char digits[5] = {0}, *end;
    strncpy(digits, json_at, 4);
    *code = (unsigned)strtoul(digits, &end, 16);
    json_at += end == digits + 4 ? 4 : 0;
    return end == digits + 4;
}

static size_t put_utf8(char *to, unsigned code) {
    int more = code < 0x80 ? 0 : code < 0x800 ? 1 : code < 0x10000 ? 2 : 3;
    static const unsigned char first[] = {0, 0xC0, 0xE0, 0xF0};
    to[0] = (char)(first[more] | code >> 6 * more);
    for (int place = 1; place <= more; place++)
        to[place] = (char)(0x80 | (code >> 6 * (more - place) & 0x3F));
    return (size_t)more + 1;
}

static bool parse_text(json *into) {
    const char *end = ++json_at;
    while (*end && *end != '"')
        end += *end == '\\' && end[1] ? 2 : 1;
    *into = (json){TEXT, 0, keep((size_t)(end - json_at) + 5), 0, NULL, NULL};
    while (*json_at && *json_at != '"') {
        char byte = *json_at++;
        if (byte != '\\') {
            into->text[into->length++] = byte;
            continue;
        }
        byte = *json_at++;
        const char *plain = "\"\\/bfnrt", *found = byte ? strchr(plain, byte) : NULL;
        unsigned code, low;
        if (found) {
            into->text[into->length++] = "\"\\/\b\f\n\r\t"[found - plain];
        } else if (byte != 'u' || !parse_hex(&code)) {
            return false;
        } else {
            const char *before = json_at;
            if (code >> 10 == 0x36 && parse_word("\\u") && parse_hex(&low) && low >> 10 == 0x37)
                code = 0x10000 + ((code & 0x3FF) << 10) + (low & 0x3FF);
            else
                json_at = before;
            into->length += put_utf8(into->text + into->length, code);
        }
    }
    return *json_at++ == '"';
}

static bool parse_items(json *into, enum form form, int depth) {
    char end = form == LIST ? ']' : '}';
    size_t room = 0;
    *into = (json){form, 0, "", 0, NULL, NULL};
    for (json_at++, skip_blanks(); *json_at != end; into->length++) {
        if (into->length == room) {
            json *items = keep((room * 2 + 4) * sizeof *items), *names = keep((room * 2 + 4) * sizeof *names);
            if (room) {
                memcpy(items, into->items, room * sizeof *items);
                memcpy(names, into->names, room * sizeof *names);
            }
            into->items = items, into->names = names, room = room * 2 + 4;
        }
        if (form == OBJECT) {
            if (*json_at != '"' || !parse_text(&into->names[into->length]))
                return false;
            skip_blanks();
            if (*json_at++ != ':')
                return false;
        }
        if (!parse_value(&into->items[into->length], depth + 1))
            return false;
        skip_blanks();
        if (*json_at == ',')
            json_at++, skip_blanks();
        else if (*json_at != end)
            return false;
    }
    json_at++;
    return true;
}

static bool parse_value(json *into, int depth) {
    skip_blanks();
    *into = (json){NONE, 0, "", 0, NULL, NULL};
    if (depth > 200)
        return false;
    if (*json_at == '"')
        return parse_text(into);
    if (*json_at == '[' || *json_at == '{')
        return parse_items(into, *json_at == '[' ? LIST : OBJECT, depth);
    if (parse_word("null"))
        return true;
    into->form = BOOLEAN, into->number = *json_at == 't';
    if (parse_word("true") || parse_word("false"))
        return true;
    char *end;
    into->form = NUMBER, into->number = strtod(json_at, &end);
    bool is_number = end != json_at && strspn(json_at, "-0123456789.eE+") >= (size_t)(end - json_at);
    json_at = end;
    return is_number;
}

/* A line as a tree; of form MISSING if it is no JSON. */
static json parse(const char *line) {
    json tree;
    json_at = line;
    bool is_json = parse_value(&tree, 0);
    skip_blanks();
    return is_json && !*json_at ? tree : missing;
}

static bool is_text(const json *value, const char *text) {
    return value->form == TEXT && value->length == strlen(text) && !memcmp(value->text, text, value->length);
}

static bool are_same_texts(const json *one, const json *other) {
    return one->length == other->length && !memcmp(one->text, other->text, one->length);
}

/* The field of an object whose name is a text; `missing` if there is none. */
static const json *field(const json *object, const json *name) {
    for (size_t place = object->form == OBJECT ? object->length : 0; place-- > 0;)
        if (are_same_texts(&object->names[place], name))
            return &object->items[place];
    return &missing;
}

static const json *get(const json *object, const char *name) {
    json text = {TEXT, 0, (char *)name, strlen(name), NULL, NULL};
    return field(object, &text);
}
