package main

import (
	"regexp"
	"strconv"
	"strings"
)

// Whether what a running server or device sent is accepted: patterns of server-conformance and device-conformance.

var part = regexp.MustCompile(`^([^{]*)(?:\{([0-9]+),([0-9]+)\})?$`)

// fitsOneRow: a row of texts, one for each step; in them .. is any byte, ... any rest.
func fitsOneRow(rows []any, answered any) bool {
	texts, isList := answered.([]any)
	return isList && anyOf(rows, func(row any) bool {
		patterns := row.([]any)
		if len(patterns) != len(texts) {
			return false
		}
		for place, pattern := range patterns {
			text, isText := texts[place].(string)
			if !isText || !fitsAnswer(strings.Fields(pattern.(string)), strings.Fields(text)) {
				return false
			}
		}
		return true
	})
}

func fitsAnswer(wanted, found []string) bool {
	if last := len(wanted) - 1; last >= 0 && wanted[last] == "..." && len(found) >= last {
		wanted, found = wanted[:last], found[:last]
	}
	for place, pattern := range wanted {
		if len(wanted) != len(found) || (pattern != found[place] && strings.TrimRight(pattern, ";") != "..") {
			return false
		}
	}
	return len(wanted) == len(found)
}

// isAccepted: the frames of each step fit a pattern of `accept`; one of `ends` ends the case.
func isAccepted(filled, answered any) bool {
	steps, _ := filled.([]any)
	received, _ := answered.([]any)
	for _, frames := range received {
		if _, isList := frames.([]any); !isList {
			return false
		}
	}
	for place, step := range steps {
		if place >= len(received) {
			return false
		}
		fits := func(pattern any) bool { return fitsFrames(parts(pattern.(string)), received[place].([]any)) }
		if anyOf(step.(object)["ends"].([]any), fits) {
			return len(received) == place+1
		}
		if !anyOf(step.(object)["accept"].([]any), fits) {
			return false
		}
	}
	return len(steps) > 0 && len(received) == len(steps)
}

// parts splits a pattern at its commas, but not at that of {0,3}.
func parts(pattern string) (found []string) {
	for _, text := range strings.Split(pattern, ", ") {
		if text = strings.TrimSpace(text); text != "" {
			found = append(found, text)
		}
	}
	return found
}

func fitsFrames(wanted []string, frames []any) bool {
	if len(wanted) == 0 {
		return len(frames) == 0
	}
	found, least, most := part.FindStringSubmatch(wanted[0]), 1, 1
	if found[2] != "" {
		least, _ = strconv.Atoi(found[2])
		most, _ = strconv.Atoi(found[3])
	}
	for count := 0; count <= most; count++ {
		if count >= least && fitsFrames(wanted[1:], frames[count:]) {
			return true
		}
		if count >= len(frames) {
			return false
		}
		text, isText := frames[count].(string)
		if !isText || !fitsFrame(found[1], text) {
			return false
		}
	}
	return false
}

// fitsFrame: a dot is any digit, [26] one of these, (?!3930) not these digits, | separates alternatives.
func fitsFrame(pattern, text string) bool {
	if one, others, isChoice := strings.Cut(pattern, "|"); isChoice {
		return fitsFrame(one, text) || fitsFrame(others, text)
	}
	before, rest, hasNot := strings.Cut(pattern, "(?!")
	if hasNot {
		not, after, _ := strings.Cut(rest, ")")
		start := len(regexp.MustCompile(`\[.*?\]`).ReplaceAllString(before, "."))
		isNot := len(text) >= start && strings.HasPrefix(text[start:], not)
		return !isNot && fitsFrame(before+after, text)
	}
	matches, err := regexp.MatchString("^(?:"+strings.ReplaceAll(pattern, ".", "[0-9A-F]")+")$", text)
	return matches && err == nil
}
