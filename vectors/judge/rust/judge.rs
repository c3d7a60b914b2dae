//! The verdict on one answer, by ../../PROTOCOL.md: judge(row) is "passed", "open", "failed" or "not offered".
//! A row is a line of questions.jsonl with the `answer` to its question; of device-conformance also `filled`, by fill.js or
//! fill.py. As a program (rustc -O judge.rs) it reads rows and writes a line for each: the id of the question, the verdict.

mod equal;
mod json;
mod patterns;

use json::Json;
use std::io::{BufRead, Write};

pub fn judge(row: &Json) -> &'static str {
    let (question, expected, answer) = (row.get("question"), row.get("expected"), row.get("answer"));
    let (kind, task, result) = (question.get("kind"), question.get("do"), row.get("result"));
    let (fields, refused) = (answer.field("is"), answer.field("refused"));
    let is_declined = answer.field("not_offered").is_some();
    let is_acceptable = result.is("acceptable") && !(kind.is("eds") && task.is("check"));
    match (fields, refused, is_declined) {
        (None, None, true) => return "not offered",
        (Some(Json::Object(_)), None, false) | (None, Some(Json::Text(_)), false) => {}
        _ => return "failed",
    }
    if result.is("invalid") && !row.get("fails").is("compare") {
        let is_right = refused.map_or(false, |reason| reason.is_empty() || reason.text() == row.get("reason").text());
        return if is_right { "passed" } else { "failed" };
    }
    let fields = match fields {
        Some(fields) => fields,
        None => return without_fields(kind, task, result, is_acceptable),
    };
    let same = as_expected(row, question, fields);
    let is_tolerant = row.get("flags").list().iter().any(|flag| flag.is("tolerant"));
    if result.is("invalid") {
        return if same || !has_form(expected, fields) { "failed" } else { "passed" };
    }
    if is_acceptable && task.is("encode") {
        return if (same && is_tolerant) || !has_form(expected, fields) { "failed" } else { "passed" };
    }
    match same {
        true => "passed",
        false if is_acceptable && !equal::is_excluded(expected, fields, question) => "open",
        false => "failed",
    }
}

/// The verdict on a refusal where none is expected.
fn without_fields(kind: &Json, task: &Json, result: &Json, is_acceptable: bool) -> &'static str {
    let may_refuse = task.is("decode") && (kind.is("drive-state") || kind.is("drive-command"));
    match () {
        _ if result.is("invalid") && may_refuse => "passed",
        _ if result.is("invalid") => "open",
        _ if is_acceptable && task.is("encode") => "passed",
        _ if is_acceptable => "open",
        _ => "failed",
    }
}

/// Whether the fields could be an answer of another case: none is missing, empty, or of another type of JSON.
fn has_form(expected: &Json, fields: &Json) -> bool {
    let wanted = if let Json::Object(wanted) = expected { wanted } else { return false };
    wanted.iter().all(|(name, value)| {
        let is_like = |found: &Json| found.form() == value.form() && (value.is_empty() || !found.is_empty());
        fields.find(name).map_or(false, is_like)
    })
}

fn as_expected(row: &Json, question: &Json, fields: &Json) -> bool {
    if question.get("kind").is("device-conformance") {
        return patterns::is_accepted(row.get("filled"), fields.get("received"));
    }
    if question.get("kind").is("server-conformance") {
        return patterns::fits_one_row(row.get("expected").get("answers").list(), fields.get("answers"));
    }
    let described = question.field("parameter").unwrap_or(question);
    let kind = described.get("type").text().unwrap_or_default();
    equal::equal(row.get("expected"), fields, "", &kind, question)
}

fn main() {
    let mut output = std::io::BufWriter::new(std::io::stdout());
    for line in std::io::stdin().lock().lines() {
        let row = Json::parse(&line.expect("a line of UTF-8")).expect("a row as JSON");
        let id = row.get("question").get("id").text().unwrap_or_default();
        writeln!(output, "{} {}", id, judge(&row)).expect("output");
    }
}
