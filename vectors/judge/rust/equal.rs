//! Whether an answer has what a case expects.

use crate::json::Json;
use crate::patterns::fits_frame;

/// `name` is that of the field, `kind` the type of a number in it.
pub fn equal(wanted: &Json, answered: &Json, name: &str, kind: &str, question: &Json) -> bool {
    match (wanted, answered) {
        (Json::Object(_), _) if wanted.field("one_of").is_some() => {
            wanted.get("one_of").list().iter().any(|choice| equal(choice, answered, name, kind, question))
        }
        (Json::Object(fields), _) => match (wanted.get("from"), wanted.get("to"), answered) {
            (Json::Number(from), Json::Number(to), Json::Number(found)) => from <= found && found <= to && found.fract() == 0.0,
            (Json::Number(_), Json::Number(_), _) => false,
            _ => {
                let is_equal = |key: &[u16], value: &Json, found: &Json| {
                    let key = String::from_utf16_lossy(key);
                    is_padded(&key, value, found, question) || equal(value, found, &key, kind, question)
                };
                answered.form() == wanted.form()
                    && fields.iter().all(|(key, value)| answered.find(key).map_or(false, |found| is_equal(key, value, found)))
            }
        },
        (Json::List(items), Json::List(others)) => {
            let in_order = !question.get("kind").is("device") && !question.get("kind").is("gateway-309-3");
            let (left, right) = (by_identifier(items, in_order), by_identifier(others, in_order));
            let entries = if question.get("kind").is("pdo") { question.get("entries").list() } else { &[] };
            let kind_at = |place| entries.get(place).map_or(kind.into(), |entry: &Json| entry.get("type").text().unwrap_or_default());
            let mut pairs = left.iter().zip(&right).enumerate();
            left.len() == right.len() && pairs.all(|(place, (one, other))| equal(one, other, name, &kind_at(place), question))
        }
        (Json::Text(units), Json::Text(others)) => {
            let (one, other) = (wanted.text().unwrap_or_default(), answered.text().unwrap_or_default());
            if question.get("kind").is("device") && one.contains("..") {
                return fits_frame(&one, &other);
            }
            let are_digits = [&one, &other].iter().all(|text| text.bytes().all(|byte| byte == b' ' || byte.is_ascii_hexdigit()));
            let are_same_digits = are_digits && plain(&one).to_uppercase() == plain(&other).to_uppercase();
            units == others || are_same_digits || (name == "value" && are_same_numbers(&one, &other, kind))
        }
        (Json::Number(one), Json::Number(other)) => one == other,
        (Json::Bool(one), Json::Bool(other)) => one == other,
        (Json::Null, Json::Null) => true,
        _ => false,
    }
}

fn plain(text: &str) -> String {
    text.replace(' ', "")
}

/// Frames in the order of their identifiers, those of one identifier as they came; other lists unchanged.
fn by_identifier(list: &[Json], in_order: bool) -> Vec<&Json> {
    let identifier = |item: &Json| -> Option<String> {
        let frame = item.get("one_of").list().first().unwrap_or(item).text()?;
        frame.split_once('#').map(|(before, _)| before.to_string())
    };
    let mut sorted: Vec<&Json> = list.iter().collect();
    if !in_order && list.iter().all(|item| identifier(item).is_some()) {
        sorted.sort_by_key(|item| identifier(item));
    }
    sorted
}

/// Bits of a response that was decoded without its request have up to seven more, all zero.
fn is_padded(name: &str, wanted: &Json, answered: &Json, question: &Json) -> bool {
    let is_response = name == "bits" && question.get("kind").is("pdu") && question.get("side").is("response");
    match (wanted.text(), answered.text()) {
        (Some(one), Some(other)) if is_response => match plain(&other).strip_prefix(&plain(&one)) {
            Some(more) => more.len() < 8 && more.bytes().all(|byte| byte == b'0'),
            None => false,
        },
        _ => false,
    }
}

/// Whether two texts are the same number: of floating point the nearest one of that type, others exactly.
fn are_same_numbers(wanted: &str, answered: &str, kind: &str) -> bool {
    if kind.starts_with('f') {
        return match (nearest(wanted, kind), nearest(answered, kind)) {
            (Some(one), Some(other)) => (one.is_nan() && other.is_nan()) || one.to_bits() == other.to_bits(),
            _ => false,
        };
    }
    let number = canonical(wanted);
    kind.starts_with(|first| "uib".contains(first)) && number.is_some() && number == canonical(answered)
}

/// A decimal number as its sign, its digits without zeros at both ends, and the exponent of the last one.
fn canonical(text: &str) -> Option<(bool, String, i64)> {
    let are_digits = |digits: &str| !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    let (mantissa, exponent) = text.split_once(|letter| letter == 'e' || letter == 'E').unwrap_or((text, "0"));
    let unsigned = mantissa.strip_prefix(|sign| sign == '+' || sign == '-').unwrap_or(mantissa);
    let (whole, part) = unsigned.split_once('.').unwrap_or((unsigned, "0"));
    let power = exponent.strip_prefix(|sign| sign == '+' || sign == '-').unwrap_or(exponent);
    if !are_digits(whole) || !are_digits(part) || !are_digits(power) || power.len() > 4 {
        return None;
    }
    let digits = format!("{}{}", whole, part);
    let kept = digits.trim_end_matches('0');
    let place = exponent.parse::<i64>().ok()? - part.len() as i64 + (digits.len() - kept.len()) as i64;
    let first = kept.trim_start_matches('0').to_string();
    Some(if first.is_empty() { (false, first, 0) } else { (text.starts_with('-'), first, place) })
}

fn nearest(text: &str, kind: &str) -> Option<f64> {
    let name = text.strip_prefix(|sign| sign == '+' || sign == '-').unwrap_or(text).to_lowercase();
    let is_named = name == "inf" || name == "nan";
    if !is_named && canonical(text).is_none() {
        return None;
    }
    let number: f64 = text.parse().ok()?;
    let number = if kind == "f32" { f64::from(number as f32) } else { number };
    (is_named || number.is_finite()).then_some(number)
}

/// Whether the answer is in a `never` of what is expected: wrong, whatever the standard leaves open.
pub fn is_excluded(wanted: &Json, answered: &Json, question: &Json) -> bool {
    match wanted {
        Json::Object(_) if wanted.field("one_of").is_some() => {
            wanted.get("never").list().iter().any(|one| equal(one, answered, "", "", question))
        }
        Json::Object(fields) => fields
            .iter()
            .any(|(key, value)| answered.find(key).map_or(false, |found| is_excluded(value, found, question))),
        Json::List(items) => items.iter().zip(answered.list()).any(|(one, other)| is_excluded(one, other, question)),
        _ => false,
    }
}
