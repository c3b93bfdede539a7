use super::{AbsentForm, EvaluationIndex, IndexEntry, IndexLayout, Overlap, SingleEntryForm, Spacing};

/// The index as Python's `json.dumps` writes it.
pub(super) fn to_json(index: &EvaluationIndex, layout: IndexLayout) -> String {
    let mut json = Json { text: String::new(), spacing: layout.spacing, depth: 0 };
    json.list('{', '}', &index.scenes, |json, (key, entries)| {
        json.key(key);
        match (entries.as_slice(), layout.single_entry, layout.absent) {
            ([], _, AbsentForm::Null) => json.text.push_str("null"),
            ([entry], SingleEntryForm::Object, _) => json.entry(entry),
            _ => json.list('[', ']', entries, Json::entry),
        }
    });
    if layout.final_newline {
        json.text.push('\n');
    }
    json.text
}

enum Field<'a> {
    Frames(&'static str, &'a [usize]),
    Number(&'static str, f64),
    Text(&'static str, &'a str),
}

struct Json {
    text: String,
    spacing: Spacing,
    depth: usize,
}

impl Json {
    fn entry(&mut self, entry: &IndexEntry) {
        let fields = [Field::Frames("context", &entry.context), Field::Frames("target", &entry.target)];
        let overlap = entry.overlap.iter().flat_map(|Overlap { value, estimator }| {
            let estimator = estimator.as_deref().map(|name| Field::Text("overlap_estimator", name));
            [Field::Number("overlap", *value)].into_iter().chain(estimator)
        });
        self.list('{', '}', fields.into_iter().chain(overlap), |json, field| match field {
            Field::Frames(name, frames) => {
                json.key(name);
                json.list('[', ']', frames, |json, frame| json.text.push_str(&frame.to_string()));
            }
            Field::Number(name, value) => {
                json.key(name);
                json.text.push_str(&python_float(value));
            }
            Field::Text(name, text) => {
                json.key(name);
                json.string(text);
            }
        });
    }

    fn list<T>(
        &mut self,
        open: char,
        close: char,
        items: impl IntoIterator<Item = T>,
        mut item: impl FnMut(&mut Self, T),
    ) {
        self.text.push(open);
        self.depth += 1;
        let mut empty = true;
        for value in items {
            if !empty {
                self.text.push(',');
            }
            match self.spacing {
                Spacing::OneLine if !empty => self.text.push(' '),
                Spacing::OneLine | Spacing::Tight => {}
                Spacing::Indent(_) => self.new_line(),
            }
            empty = false;
            item(self, value);
        }
        self.depth -= 1;
        if !empty && matches!(self.spacing, Spacing::Indent(_)) {
            self.new_line();
        }
        self.text.push(close);
    }

    fn new_line(&mut self) {
        let Spacing::Indent(width) = self.spacing else { return };
        self.text.push('\n');
        self.text.extend(std::iter::repeat_n(' ', self.depth * usize::from(width)));
    }

    fn key(&mut self, key: &str) {
        self.string(key);
        self.text.push_str(if self.spacing == Spacing::Tight { ":" } else { ": " });
    }

    fn string(&mut self, text: &str) {
        self.text.push('"');
        text.chars().for_each(|character| self.escaped(character));
        self.text.push('"');
    }

    /// As `json.dumps` with `ensure_ascii`: printable ASCII as it is, everything else as `\uXXXX`.
    fn escaped(&mut self, character: char) {
        match character {
            '"' => self.text.push_str("\\\""),
            '\\' => self.text.push_str("\\\\"),
            '\n' => self.text.push_str("\\n"),
            '\r' => self.text.push_str("\\r"),
            '\t' => self.text.push_str("\\t"),
            '\u{8}' => self.text.push_str("\\b"),
            '\u{c}' => self.text.push_str("\\f"),
            ' '..='~' => self.text.push(character),
            _ => {
                let mut buffer = [0; 2];
                let units = character.encode_utf16(&mut buffer).iter();
                self.text.extend(units.map(|unit| format!("\\u{unit:04x}")));
            }
        }
    }
}

/// Python's `repr` of a float: the shortest digits that read back the same, in scientific notation below
/// 1e-4 and from 1e16, with at least two digits in the exponent. A non-finite value, which the parser never
/// yields, becomes `null`.
fn python_float(value: f64) -> String {
    if !value.is_finite() {
        return "null".to_owned();
    }
    let plain = value == 0.0 || (1e-4..1e16).contains(&value.abs());
    if plain {
        return format!("{value:?}");
    }
    let scientific = format!("{value:e}");
    match scientific.split_once('e') {
        Some((digits, exponent)) => {
            let (sign, size) = exponent.strip_prefix('-').map_or(('+', exponent), |size| ('-', size));
            format!("{digits}e{sign}{size:0>2}")
        }
        None => scientific,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::IndexFile;

    /// The right-hand sides are what `CPython` 3.11 prints.
    #[test]
    fn formats_floats_as_python_does() {
        for (value, text) in [
            (0.4, "0.4"),
            (0.79976, "0.79976"),
            (1.0, "1.0"),
            (0.0, "0.0"),
            (0.0001, "0.0001"),
            (0.00001, "1e-05"),
            (1.5e-7, "1.5e-07"),
            (2.5e-300, "2.5e-300"),
            (1e15, "1000000000000000.0"),
            (1e16, "1e+16"),
            (0.1 + 0.2, "0.30000000000000004"),
        ] {
            assert_eq!(python_float(value), text);
        }
    }

    /// `json.dumps({"é\x7f😀\"\\\n\r\t\b\f\v": None})` in `CPython` 3.11.
    #[test]
    fn escapes_keys_as_python_does() {
        let index = EvaluationIndex {
            scenes: [("é\u{7f}😀\"\\\n\r\t\u{8}\u{c}\u{b}".to_owned(), vec![])].into_iter().collect(),
        };
        assert_eq!(index.to_json(&IndexLayout::default()), r#"{"\u00e9\u007f\ud83d\ude00\"\\\n\r\t\b\f\u000b": null}"#);
    }

    #[test]
    fn writes_every_published_layout() {
        let entry = IndexEntry { context: vec![1, 5], target: vec![], overlap: Some(0.5.into()) };
        let index =
            EvaluationIndex { scenes: [("a".to_owned(), vec![entry]), ("b".to_owned(), vec![])].into_iter().collect() };
        assert_eq!(
            index.to_json(&IndexLayout::PIXELSPLAT),
            r#"{"a": {"context": [1, 5], "target": [], "overlap": 0.5}, "b": null}"#
        );
        assert_eq!(
            index.to_json(&IndexLayout::LATENTSPLAT),
            r#"{"a": [{"context": [1, 5], "target": [], "overlap": 0.5}], "b": []}"#
        );
        let indented = "{\n    \"a\": {\n        \"context\": [\n            1,\n            5\n        ],\n        \
             \"target\": [],\n        \"overlap\": 0.5\n    },\n    \"b\": null\n}";
        assert_eq!(index.to_json(&IndexLayout::NOPOSPLAT), indented);
    }

    fn any_index() -> impl Strategy<Value = EvaluationIndex> {
        let frames = || prop::collection::vec(0..=IndexEntry::MAX_FRAME, 0..4);
        let overlap = (0.0..=1.0, prop::option::of("[a-z é\"-]{1,12}"))
            .prop_map(|(value, estimator)| Overlap { value, estimator });
        let entry = (frames(), frames(), prop::option::of(overlap)).prop_map(|(context, target, overlap)| IndexEntry {
            context,
            target,
            overlap,
        });
        prop::collection::vec((any::<String>(), prop::collection::vec(entry, 0..3)), 0..6)
            .prop_map(|scenes| EvaluationIndex { scenes: scenes.into_iter().collect() })
    }

    fn any_layout() -> impl Strategy<Value = IndexLayout> {
        let spacing = prop_oneof![Just(Spacing::OneLine), Just(Spacing::Tight), (0u8..5).prop_map(Spacing::Indent)];
        let single = prop_oneof![Just(SingleEntryForm::Object), Just(SingleEntryForm::List)];
        let absent = prop_oneof![Just(AbsentForm::Null), Just(AbsentForm::EmptyList)];
        (spacing, single, absent, any::<bool>()).prop_map(|(spacing, single_entry, absent, final_newline)| {
            IndexLayout { spacing, single_entry, absent, final_newline }
        })
    }

    proptest! {
        #[test]
        fn reads_back_what_was_written(index in any_index(), layout in any_layout()) {
            let text = index.to_json(&layout);
            let file = IndexFile::parse(text.as_bytes()).unwrap();
            prop_assert_eq!(&file.index, &index);
            prop_assert_eq!(file.index.content_hash(), index.content_hash());
        }

        #[test]
        fn writing_with_the_layout_that_was_read_gives_identical_bytes(index in any_index(), layout in any_layout()) {
            // A first key with an escaped quote may hide the spacing; every other file is reproduced exactly.
            prop_assume!(index.scenes.keys().next().is_none_or(|key| !key.contains('"')));
            let text = index.to_json(&layout);
            let file = IndexFile::parse(text.as_bytes()).unwrap();
            prop_assert_eq!(file.index.to_json(&file.layout), text);
        }
    }
}
