/// Text for GitHub's Markdown, in which nothing is markup, HTML, a formula or a cell's end; control characters, such as line
/// breaks, become spaces.
pub fn escaped_markdown(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '\\' | '|' | '*' | '_' | '`' | '[' | ']' | '~' | '$' => {
                safe.push('\\');
                safe.push(letter);
            }
            letter if letter.is_control() => safe.push(' '),
            letter => safe.push(letter),
        }
    }
    safe
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_no_markup() {
        assert_eq!(escaped_markdown("<b>x & y"), "&lt;b&gt;x &amp; y");
        assert_eq!(escaped_markdown("a*b*c|d_e"), "a\\*b\\*c\\|d\\_e");
        assert_eq!(escaped_markdown("two\nlines, -0.5 dB"), "two lines, -0.5 dB");
    }
}
