//! JSON for the judge: a line becomes a tree. Of a name that comes twice the last one counts.

pub enum Json {
    Null,
    Bool(bool),
    Number(f64),
    /// As UTF-16, since a text of JSON may hold half of a pair.
    Text(Vec<u16>),
    List(Vec<Json>),
    Object(Vec<(Vec<u16>, Json)>),
}

pub static MISSING: Json = Json::Null;

impl Json {
    pub fn parse(line: &str) -> Option<Json> {
        let mut reader = Reader { line, bytes: line.as_bytes(), at: 0 };
        let value = reader.value(0)?;
        reader.skip_blanks();
        (reader.at == line.len()).then_some(value)
    }

    pub fn find(&self, name: &[u16]) -> Option<&Json> {
        match self {
            Json::Object(fields) => fields.iter().rev().find(|field| field.0 == name).map(|field| &field.1),
            _ => None,
        }
    }

    pub fn field(&self, name: &str) -> Option<&Json> {
        self.find(&name.encode_utf16().collect::<Vec<u16>>())
    }

    /// The field; null if there is none.
    pub fn get(&self, name: &str) -> &Json {
        self.field(name).unwrap_or(&MISSING)
    }

    pub fn text(&self) -> Option<String> {
        match self {
            Json::Text(units) => Some(String::from_utf16_lossy(units)),
            _ => None,
        }
    }

    pub fn is(&self, text: &str) -> bool {
        self.text().as_deref() == Some(text)
    }

    pub fn list(&self) -> &[Json] {
        match self {
            Json::List(items) => items,
            _ => &[],
        }
    }

    pub fn form(&self) -> u8 {
        match self {
            Json::Null => 0,
            Json::Bool(_) => 1,
            Json::Number(_) => 2,
            Json::Text(_) => 3,
            Json::List(_) => 4,
            Json::Object(_) => 5,
        }
    }

    pub fn is_empty(&self) -> bool {
        match self {
            Json::Text(units) => units.is_empty(),
            Json::List(items) => items.is_empty(),
            Json::Object(fields) => fields.is_empty(),
            _ => false,
        }
    }
}

struct Reader<'a> {
    line: &'a str,
    bytes: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn skip_blanks(&mut self) {
        while matches!(self.bytes.get(self.at), Some(b' ' | b'\t' | b'\r' | b'\n')) {
            self.at += 1;
        }
    }

    fn take(&mut self, word: &str) -> bool {
        let is_next = self.bytes[self.at..].starts_with(word.as_bytes());
        self.at += if is_next { word.len() } else { 0 };
        is_next
    }

    fn value(&mut self, depth: usize) -> Option<Json> {
        self.skip_blanks();
        match self.bytes.get(self.at)? {
            _ if depth > 200 => None,
            b'"' => Some(Json::Text(self.string()?)),
            b'[' => Some(Json::List(self.items(b']', |reader| reader.value(depth + 1))?)),
            b'{' => Some(Json::Object(self.items(b'}', |reader| {
                let name = reader.string()?;
                reader.skip_blanks();
                reader.take(":").then_some(())?;
                Some((name, reader.value(depth + 1)?))
            })?)),
            _ if self.take("null") => Some(Json::Null),
            _ if self.take("true") => Some(Json::Bool(true)),
            _ if self.take("false") => Some(Json::Bool(false)),
            _ => {
                let rest = &self.bytes[self.at..];
                let size = rest.iter().take_while(|byte| b"-+.eE0123456789".contains(byte)).count();
                self.at += size;
                self.line[self.at - size..self.at].parse().ok().map(Json::Number)
            }
        }
    }

    fn items<T>(&mut self, end: u8, mut item: impl FnMut(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let mut found = Vec::new();
        self.at += 1;
        self.skip_blanks();
        while *self.bytes.get(self.at)? != end {
            found.push(item(self)?);
            self.skip_blanks();
            if self.take(",") {
                self.skip_blanks();
            } else if *self.bytes.get(self.at)? != end {
                return None;
            }
        }
        self.at += 1;
        Some(found)
    }

    fn string(&mut self) -> Option<Vec<u16>> {
        let mut units = Vec::new();
        self.take("\"").then_some(())?;
        loop {
            let character = self.line.get(self.at..)?.chars().next()?;
            self.at += character.len_utf8();
            if character == '"' {
                return Some(units);
            }
            if character != '\\' {
                units.extend(character.encode_utf16(&mut [0; 2]).iter());
                continue;
            }
            let escape = *self.bytes.get(self.at)?;
            self.at += 1;
            if escape == b'u' {
                let digits = self.line.get(self.at..self.at + 4)?;
                units.push(u16::from_str_radix(digits, 16).ok()?);
                self.at += 4;
            } else {
                let place = b"\"\\/bfnrt".iter().position(|byte| *byte == escape)?;
                units.push(u16::from(b"\"\\/\x08\x0C\n\r\t"[place]));
            }
        }
    }
}
