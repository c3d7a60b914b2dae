package main

// Whether an answer has what a case expects.

import (
	"math"
	"math/big"
	"regexp"
	"sort"
	"strconv"
	"strings"
)

var (
	digits = regexp.MustCompile(`^[0-9A-Fa-f ]*$`)
	number = regexp.MustCompile(`^[+-]?[0-9]+(\.[0-9]+)?([eE][+-]?[0-9]{1,4})?$`)
	named  = regexp.MustCompile(`^(?i)[+-]?(inf|nan)$`)
	padded = regexp.MustCompile(`^0{0,7}$`)
)

// equal tells whether an answer has what is wanted. `name` is that of the field, `kind` the type of a number in it.
func equal(wanted, answered any, name, kind string, question object) bool {
	switch wanted := wanted.(type) {
	case object:
		if choices, isChoice := wanted["one_of"].([]any); isChoice {
			return anyOf(choices, func(choice any) bool { return equal(choice, answered, name, kind, question) })
		}
		from, isFrom := wanted["from"].(float64)
		to, isTo := wanted["to"].(float64)
		if isFrom && isTo {
			found, isNumber := answered.(float64)
			return isNumber && from <= found && found <= to && found == math.Floor(found)
		}
		fields, areFields := answered.(object)
		for key, value := range wanted {
			found, isThere := fields[key]
			if !isThere || !(isPadded(key, value, found, question) || equal(value, found, key, kind, question)) {
				return false
			}
		}
		return areFields
	case []any:
		items, isList := answered.([]any)
		if !isList || len(items) != len(wanted) {
			return false
		}
		if question["kind"] == "device" || question["kind"] == "gateway-309-3" {
			wanted, items = byIdentifier(wanted), byIdentifier(items)
		}
		entries, _ := question["entries"].([]any)
		for place, value := range wanted {
			inside := kind
			if question["kind"] == "pdo" && place < len(entries) {
				inside, _ = entries[place].(object)["type"].(string)
			}
			if !equal(value, items[place], name, inside, question) {
				return false
			}
		}
		return true
	case string:
		text, isText := answered.(string)
		switch {
		case !isText:
			return false
		case question["kind"] == "device" && strings.Contains(wanted, ".."):
			return fitsFrame(wanted, text)
		case wanted == text, name == "value" && areSameNumbers(wanted, text, kind):
			return true
		}
		return digits.MatchString(wanted) && digits.MatchString(text) && strings.ToUpper(plain(wanted)) == strings.ToUpper(plain(text))
	}
	return wanted == answered
}

func plain(text string) string { return strings.ReplaceAll(text, " ", "") }

func anyOf(items []any, is func(any) bool) bool {
	for _, item := range items {
		if is(item) {
			return true
		}
	}
	return false
}

// byIdentifier returns frames in the order of their identifiers, those of one identifier as they came; other lists unchanged.
func byIdentifier(list []any) []any {
	identifier := func(item any) (string, bool) {
		if choice, isChoice := item.(object); isChoice {
			if choices, _ := choice["one_of"].([]any); len(choices) > 0 {
				item = choices[0]
			}
		}
		text, _ := item.(string)
		before, _, isFrame := strings.Cut(text, "#")
		return before, isFrame
	}
	for _, item := range list {
		if _, isFrame := identifier(item); !isFrame {
			return list
		}
	}
	sorted := append([]any{}, list...)
	sort.SliceStable(sorted, func(one, other int) bool {
		before, _ := identifier(sorted[one])
		after, _ := identifier(sorted[other])
		return before < after
	})
	return sorted
}

// isPadded allows bits of a response that was decoded without its request up to seven more, all zero.
func isPadded(name string, wanted, answered any, question object) bool {
	short, isText := wanted.(string)
	long, areBits := answered.(string)
	isResponse := name == "bits" && question["kind"] == "pdu" && question["side"] == "response"
	short, long = plain(short), plain(long)
	return isResponse && isText && areBits && strings.HasPrefix(long, short) && padded.MatchString(long[len(short):])
}

// areSameNumbers compares two texts: of floating point the nearest numbers of that type, others exactly.
func areSameNumbers(wanted, answered, kind string) bool {
	if strings.HasPrefix(kind, "f") {
		one, isOne := nearest(wanted, kind)
		other, isOther := nearest(answered, kind)
		areBothNaN := math.IsNaN(one) && math.IsNaN(other)
		return isOne && isOther && (areBothNaN || math.Float64bits(one) == math.Float64bits(other))
	}
	if kind == "" || !strings.Contains("uib", kind[:1]) || !number.MatchString(wanted) || !number.MatchString(answered) {
		return false
	}
	one, _ := new(big.Rat).SetString(wanted)
	other, _ := new(big.Rat).SetString(answered)
	return one.Cmp(other) == 0
}

func nearest(text, kind string) (float64, bool) {
	if !number.MatchString(text) && !named.MatchString(text) {
		return 0, false
	}
	value, _ := strconv.ParseFloat(text, 64)
	if kind == "f32" {
		value = float64(float32(value))
	}
	return value, named.MatchString(text) || !math.IsInf(value, 0)
}
