//! Whether what a running server or device sent is accepted: patterns of server-conformance and device-conformance.

use crate::json::Json;

/// server-conformance: a row of texts, one for each step; in them .. is any byte, ... any rest.
pub fn fits_one_row(rows: &[Json], answered: &Json) -> bool {
    let texts: Option<Vec<String>> = answered.list().iter().map(Json::text).collect();
    let texts = match (answered, texts) {
        (Json::List(_), Some(texts)) => texts,
        _ => return false,
    };
    rows.iter().any(|row| {
        let mut pairs = row.list().iter().zip(&texts);
        row.list().len() == texts.len() && pairs.all(|(pattern, text)| fits_answer(&pattern.text().unwrap_or_default(), text))
    })
}

fn fits_answer(pattern: &str, text: &str) -> bool {
    let mut wanted: Vec<&str> = pattern.split_whitespace().collect();
    let mut found: Vec<&str> = text.split_whitespace().collect();
    if wanted.last() == Some(&"...") {
        wanted.pop();
        found.truncate(wanted.len());
    }
    wanted.len() == found.len()
        && wanted.iter().zip(&found).all(|(byte, other)| byte == other || byte.trim_end_matches(';') == "..")
}

/// device-conformance: the frames of each step fit a pattern of `accept`; one of `ends` ends the case.
pub fn is_accepted(filled: &Json, received: &Json) -> bool {
    let (steps, received) = (filled.list(), received.list());
    if steps.is_empty() || received.iter().any(|frames| !matches!(frames, Json::List(_))) {
        return false;
    }
    for (place, (step, frames)) in steps.iter().zip(received).enumerate() {
        let fits = |name| {
            step.get(name).list().iter().any(|pattern: &Json| {
                let pattern = pattern.text().unwrap_or_default();
                let parts: Vec<&str> = pattern.split(", ").filter(|part| !part.is_empty()).collect();
                fits_frames(&parts, frames.list())
            })
        };
        if fits("ends") {
            return received.len() == place + 1;
        }
        if !fits("accept") {
            return false;
        }
    }
    received.len() == steps.len()
}

fn fits_frames(parts: &[&str], frames: &[Json]) -> bool {
    let (part, rest) = match parts.split_first() {
        Some((part, rest)) => (*part, rest),
        None => return frames.is_empty(),
    };
    let (pattern, counts) = part.trim_end_matches('}').split_once('{').unwrap_or((part, "1,1"));
    let (least, most) = counts.split_once(',').unwrap_or((counts, counts));
    let (least, most): (usize, usize) = (least.parse().unwrap_or(1), most.parse().unwrap_or(1));
    for count in 0..=most {
        if count >= least && fits_frames(rest, &frames[count..]) {
            return true;
        }
        if !frames.get(count).and_then(Json::text).map_or(false, |text| fits_frame(pattern, &text)) {
            return false;
        }
    }
    false
}

/// A dot is any digit, [26] one of these, (?!3930) not these digits, | separates alternatives.
pub fn fits_frame(pattern: &str, text: &str) -> bool {
    pattern.split('|').any(|alternative| fits(alternative.as_bytes(), text.as_bytes()))
}

fn fits(pattern: &[u8], text: &[u8]) -> bool {
    if let Some(rest) = pattern.strip_prefix(b"(?!") {
        let end = rest.iter().position(|byte| *byte == b')').unwrap_or(0);
        return !text.starts_with(&rest[..end]) && fits(&rest[end + 1..], text);
    }
    let (byte, others) = match (pattern.first(), text.split_first()) {
        (Some(_), Some((byte, others))) => (*byte, others),
        (first, second) => return first.is_none() && second.is_none(),
    };
    match pattern[0] {
        b'.' => matches!(byte, b'0'..=b'9' | b'A'..=b'F') && fits(&pattern[1..], others),
        b'[' => {
            let end = pattern.iter().position(|byte| *byte == b']').unwrap_or(0);
            let ranges = pattern[1..end].windows(3).any(|range| range[1] == b'-' && range[0] <= byte && byte <= range[2]);
            (ranges || (byte != b'-' && pattern[1..end].contains(&byte))) && fits(&pattern[end + 1..], others)
        }
        wanted => wanted == byte && fits(&pattern[1..], others),
    }
}
