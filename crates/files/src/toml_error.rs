use crate::Malformed;

/// The error of a TOML file, with line and column counted from 1: `what` it is, and what the `whole` of it should be.
pub fn malformed_toml(what: &'static str, whole: &str, text: &str, error: &toml::de::Error) -> Malformed {
    let message = error.message();
    let start = error.span().map_or(0, |span| span.start);
    let start = unknown_field(message, text, start).unwrap_or(start);
    let before = text.bytes().take(start);
    let line = before.clone().filter(|byte| *byte == b'\n').count() + 1;
    let is_char_start = |byte: &u8| byte & 0b1100_0000 != 0b1000_0000;
    let column = before.rev().take_while(|byte| *byte != b'\n').filter(is_char_start).count() + 1;
    let (found, expected) = message.rsplit_once(", expected ").unwrap_or((message, whole));
    Malformed::new(what, format!("line {line} column {column}"), expected, found)
}

/// The position of a field that its table does not define. The parser reports only the position of the table.
fn unknown_field(message: &str, text: &str, table: usize) -> Option<usize> {
    let (name, _) = message.strip_prefix("unknown field `")?.split_once('`')?;
    let text = text.get(table..)?;
    let is_key = |at: usize| {
        let before = text.get(..at).and_then(|before| before.chars().next_back());
        let after = text.get(at + name.len()..).unwrap_or_default().trim_start_matches(['"', '\'', ' ', '\t']);
        before.is_none_or(|before| before.is_whitespace() || "{,.\"'".contains(before)) && after.starts_with('=')
    };
    text.match_indices(name).map(|(at, _)| at).find(|at| is_key(*at)).map(|at| table + at)
}
