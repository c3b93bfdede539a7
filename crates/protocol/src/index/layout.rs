/// The formatting of an index file, sufficient to reproduce official files byte for byte.
///
/// The default is pixelSplat's: Python's `json.dumps(index)` without options.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct IndexLayout {
    /// White space between tokens.
    pub spacing: Spacing,
    /// How a scene with exactly one entry is written.
    pub single_entry: SingleEntryForm,
    /// How a scene without entries is written.
    pub absent: AbsentForm,
    /// Whether the file ends in a line feed. No official file does.
    pub final_newline: bool,
}

impl IndexLayout {
    /// pixelSplat, MVSplat and DepthSplat: one line, objects and `null`.
    pub const PIXELSPLAT: Self = Self {
        spacing: Spacing::OneLine,
        single_entry: SingleEntryForm::Object,
        absent: AbsentForm::Null,
        final_newline: false,
    };
    /// NoPoSplat: `json.dump(index, indent=4)`, objects and `null`.
    pub const NOPOSPLAT: Self = Self { spacing: Spacing::Indent(4), ..Self::PIXELSPLAT };
    /// latentSplat: one line, a list for every scene, the empty list for scenes that the protocol leaves out.
    pub const LATENTSPLAT: Self =
        Self { single_entry: SingleEntryForm::List, absent: AbsentForm::EmptyList, ..Self::PIXELSPLAT };
}

/// White space between the tokens of an index file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Spacing {
    /// Python's default separators, `", "` and `": "`, on one line.
    #[default]
    OneLine,
    /// No white space at all.
    Tight,
    /// One element per line, indented by this many spaces per level (`json.dumps(…, indent=n)`).
    Indent(u8),
}

/// How a scene with exactly one entry is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SingleEntryForm {
    /// The entry itself (pixelSplat, NoPoSplat, DepthSplat).
    #[default]
    Object,
    /// A list of one (latentSplat).
    List,
}

/// How a scene without entries is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AbsentForm {
    /// `null` (pixelSplat, NoPoSplat, DepthSplat).
    #[default]
    Null,
    /// `[]` (latentSplat).
    EmptyList,
}

impl Spacing {
    /// Detects the spacing from the first bytes of a JSON object.
    pub(super) fn of_json(bytes: &[u8]) -> Self {
        let Some(open) = bytes.iter().position(|byte| *byte == b'{') else { return Self::default() };
        let (_, after) = bytes.split_at(open + 1);
        let (white, rest) = after.split_at(after.iter().take_while(|byte| byte.is_ascii_whitespace()).count());
        if let Some(line) = white.iter().rposition(|byte| *byte == b'\n') {
            return u8::try_from(white.len() - line - 1).map_or_else(|_| Self::default(), Self::Indent);
        }
        // The first character after the colon of the first key; a key with an escaped quote may mislead this.
        let colon = rest.iter().skip(1).position(|byte| *byte == b'"').map(|end| end + 2);
        match colon.and_then(|colon| rest.get(colon..)) {
            Some([b':', next, ..]) if !next.is_ascii_whitespace() => Self::Tight,
            _ => Self::OneLine,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detects_the_spacing_from_the_first_key() {
        for (text, spacing) in [
            (r#"{"a": null, "b": null}"#, Spacing::OneLine),
            (r#"{"a":null,"b":null}"#, Spacing::Tight),
            ("{\n    \"a\": null\n}", Spacing::Indent(4)),
            ("{\r\n\r\n  \"a\": null\n}", Spacing::Indent(2)),
            ("{\n\"a\": null\n}", Spacing::Indent(0)),
            ("{}", Spacing::OneLine),
            ("", Spacing::OneLine),
            ("{\"", Spacing::OneLine),
            ("{\"\":", Spacing::OneLine),
        ] {
            assert_eq!(Spacing::of_json(text.as_bytes()), spacing, "{text:?}");
        }
    }
}
