/* An adapter without a stack: it has read its answers from a file, a line "ID<tab>ANSWER" for each question, the hello
 * first. What remains of the time of a run is the time of the one who asks. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static char *ids[1 << 17];
static size_t count;

static int by_id(const void *one, const void *other) {
    return strcmp(*(char *const *)one, *(char *const *)other);
}

int main(int argc, char **argv) {
    FILE *file = argc == 2 ? fopen(argv[1], "r") : NULL;
    char *line = NULL;
    size_t room = 0;
    if (!file)
        return 1;
    for (; count < sizeof ids / sizeof *ids && getline(&line, &room, file) > 0; count++) {
        ids[count] = strdup(line);
        *strchr(ids[count], '\t') = 0; /* the answer is behind the id */
    }
    qsort(ids, count, sizeof *ids, by_id);
    while (getline(&line, &room, stdin) > 0) {
        char *name = strstr(line, "\"id\":"), *id = name ? strchr(name + 5, '"') + 1 : NULL;
        if (id)
            *strchr(id, '"') = 0;
        char *key = id ? id : "hello", **found = bsearch(&key, ids, count, sizeof *ids, by_id);
        if (!found)
            return 1;
        fputs(*found + strlen(*found) + 1, stdout);
        fflush(stdout);
    }
    return 0;
}
