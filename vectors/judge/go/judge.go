// The verdict on one answer, by ../../PROTOCOL.md: Judge(row) is "passed", "open", "failed" or "not offered".
// A row is a line of questions.jsonl with the `answer` to its question; of device-conformance also `filled`, by fill.js or
// fill.py. As a program (go run judge.go equal.go patterns.go) it reads rows and writes a line for each: the id, the verdict.
package main

import (
	"bufio"
	"encoding/json"
	"fmt"
	"os"
)

type object = map[string]any

// Judge returns the verdict on an answer.
func Judge(row object) string {
	question, expected, result := row["question"].(object), row["expected"].(object), row["result"]
	answer, _ := row["answer"].(object)
	is, hasFields := answer["is"]
	refusal, isRefusal := answer["refused"]
	_, isDeclined := answer["not_offered"]
	fields, areFields := is.(object)
	refused, isText := refusal.(string)
	operation := fmt.Sprint(question["kind"], ".", question["do"])
	isAcceptable := result == "acceptable" && operation != "eds.check"
	switch {
	case hasFields && isRefusal, hasFields && isDeclined, isRefusal && isDeclined:
		return "failed"
	case isDeclined:
		return "not offered"
	case hasFields && !areFields, !hasFields && !isText:
		return "failed"
	case result == "invalid" && row["fails"] != "compare":
		return either(isRefusal && (refused == "" || refused == row["reason"]), "passed", "failed")
	}
	same := hasFields && asExpected(row, question, fields)
	switch {
	case result == "invalid" && !hasFields:
		return either(operation == "drive-state.decode" || operation == "drive-command.decode", "passed", "open")
	case result == "invalid":
		return either(same || !hasForm(expected, fields), "failed", "passed")
	case isAcceptable && question["do"] == "encode":
		isWrong := same && contains(row["flags"], "tolerant")
		return either(hasFields && (isWrong || !hasForm(expected, fields)), "failed", "passed")
	case same:
		return "passed"
	}
	return either(isAcceptable && !isExcluded(expected, fields, question), "open", "failed")
}

func either(condition bool, one, other string) string {
	if condition {
		return one
	}
	return other
}

func contains(list any, text string) bool {
	items, _ := list.([]any)
	for _, item := range items {
		if item == text {
			return true
		}
	}
	return false
}

// hasForm tells whether the fields could be an answer of another case: none is missing, empty, or of another type of JSON.
func hasForm(expected, fields object) bool {
	isEmpty := func(value any) bool {
		list, isList := value.([]any)
		fields, areFields := value.(object)
		return value == "" || (isList && len(list) == 0) || (areFields && len(fields) == 0)
	}
	for name, value := range expected {
		found, isThere := fields[name]
		if !isThere || fmt.Sprintf("%T", found) != fmt.Sprintf("%T", value) || (isEmpty(found) && !isEmpty(value)) {
			return false
		}
	}
	return true
}

func asExpected(row, question, fields object) bool {
	expected := row["expected"].(object)
	switch question["kind"] {
	case "device-conformance":
		return isAccepted(row["filled"], fields["received"])
	case "server-conformance":
		return fitsOneRow(expected["answers"].([]any), fields["answers"])
	}
	described := question
	if parameter, isThere := question["parameter"].(object); isThere {
		described = parameter
	}
	kind, _ := described["type"].(string)
	return equal(expected, fields, "", kind, question)
}

// isExcluded tells whether the answer is in a `never` of what is expected: wrong, whatever the standard leaves open.
func isExcluded(wanted, answered any, question object) bool {
	switch wanted := wanted.(type) {
	case object:
		if _, isChoice := wanted["one_of"]; isChoice {
			never, _ := wanted["never"].([]any)
			return anyOf(never, func(one any) bool { return equal(one, answered, "", "", question) })
		}
		fields, _ := answered.(object)
		for key, value := range wanted {
			if found, isThere := fields[key]; isThere && isExcluded(value, found, question) {
				return true
			}
		}
	case []any:
		items, _ := answered.([]any)
		for place := 0; place < len(wanted) && place < len(items); place++ {
			if isExcluded(wanted[place], items[place], question) {
				return true
			}
		}
	}
	return false
}

func main() {
	lines := bufio.NewScanner(os.Stdin)
	lines.Buffer(nil, 1<<26)
	for lines.Scan() {
		var row object
		if err := json.Unmarshal(lines.Bytes(), &row); err != nil {
			fmt.Fprintln(os.Stderr, err)
			os.Exit(1)
		}
		fmt.Println(row["question"].(object)["id"], Judge(row))
	}
}
