/* The verdict on one answer, by ../../PROTOCOL.md: judge(&row) is "passed", "open", "failed" or "not offered".
 * A row is a line of questions.jsonl with the `answer` to its question; of device-conformance also `filled`, by fill.js or
 * fill.py. As a program (cc -O2 judge.c -lm) it reads rows and writes a line for each: the id of the question, the verdict. */
#include "json.h"
#include "patterns.h"
#include "equal.h"

static bool as_expected(const json *row, const json *question, const json *fields) {
    const json *expected = get(row, "expected"), *kind = get(question, "kind"), *parameter = get(question, "parameter");
    if (is_text(kind, "device-conformance"))
        return is_accepted(get(row, "filled"), get(fields, "received"));
    if (is_text(kind, "server-conformance"))
        return fits_one_row(get(expected, "answers"), get(fields, "answers"));
    const json *type = get(parameter->form == OBJECT ? parameter : question, "type");
    return equal(expected, fields, &missing, type, question);
}

/* Whether the fields could be an answer of another case: none is missing, empty, or of another type of JSON. */
static bool has_form(const json *expected, const json *fields) {
    for (size_t place = 0; place < expected->length; place++) {
        const json *wanted = &expected->items[place], *answered = field(fields, &expected->names[place]);
        if (answered->form != wanted->form || (wanted->form >= TEXT && wanted->length && !answered->length))
            return false;
    }
    return true;
}

/* Whether the answer is in a `never` of what is expected: wrong, whatever the standard leaves open. */
static bool is_excluded(const json *wanted, const json *answered, const json *question) {
    const json *never = get(wanted, "never");
    for (size_t place = 0; place < never->length && get(wanted, "one_of")->form == LIST; place++)
        if (equal(&never->items[place], answered, &missing, &missing, question))
            return true;
    bool are_pairs = wanted->form >= LIST && wanted->form == answered->form && get(wanted, "one_of")->form == MISSING;
    for (size_t place = 0; are_pairs && place < wanted->length; place++) {
        const json *other = wanted->form == OBJECT ? field(answered, &wanted->names[place]) : &missing;
        if (wanted->form == LIST && place < answered->length)
            other = &answered->items[place];
        if (is_excluded(&wanted->items[place], other, question))
            return true;
    }
    return false;
}

static const char *judge(const json *row) {
    const json *question = get(row, "question"), *expected = get(row, "expected"), *answer = get(row, "answer");
    const json *fields = get(answer, "is"), *refused = get(answer, "refused"), *kind = get(question, "kind"), *task = get(question, "do");
    const json *result = get(row, "result"), *fails = get(row, "fails"), *flags = get(row, "flags");
    bool has_fields = fields->form != MISSING, is_declined = get(answer, "not_offered")->form != MISSING;
    bool is_acceptable = is_text(result, "acceptable") && !(is_text(kind, "eds") && is_text(task, "check"));
    bool may_refuse = is_text(task, "decode") && (is_text(kind, "drive-state") || is_text(kind, "drive-command"));
    if (has_fields + (refused->form != MISSING) + is_declined != 1)
        return "failed";
    if (is_declined)
        return "not offered";
    if (has_fields ? fields->form != OBJECT : refused->form != TEXT)
        return "failed";
    if (is_text(result, "invalid") && !is_text(fails, "compare"))
        return !has_fields && (!refused->length || are_same_texts(refused, get(row, "reason"))) ? "passed" : "failed";
    bool same = has_fields && as_expected(row, question, fields);
    if (is_text(result, "invalid") && !has_fields)
        return may_refuse ? "passed" : "open";
    if (is_text(result, "invalid"))
        return same || !has_form(expected, fields) ? "failed" : "passed";
    if (is_acceptable && is_text(task, "encode")) {
        bool is_wrong = false;
        for (size_t place = 0; place < flags->length; place++)
            is_wrong |= same && is_text(&flags->items[place], "tolerant");
        return has_fields && (is_wrong || !has_form(expected, fields)) ? "failed" : "passed";
    }
    if (same)
        return "passed";
    return is_acceptable && !(has_fields && is_excluded(expected, fields, question)) ? "open" : "failed";
}

int main(void) {
    char *line = NULL;
    size_t room = 0;
    while (getline(&line, &room, stdin) > 0) {
        json row = parse(line);
        printf("%s %s\n", get(get(&row, "question"), "id")->text, judge(&row));
        json_free();
    }
    free(line);
    return 0;
}
