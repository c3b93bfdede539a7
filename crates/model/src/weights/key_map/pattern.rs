use std::fmt;

/// The longest name in bytes. Both limits keep matching fast for any file.
const MAX_NAME: usize = 256;
/// The most wildcards of a pattern.
const MAX_WILDCARDS: usize = 3;

/// A name with wildcards: `*` matches one or more characters except dots, `**` one or more of any.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Pattern {
    pieces: Vec<Piece>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Piece {
    Literal(String),
    /// Counted from 0 in the order of the source pattern.
    Wildcard {
        number: usize,
        crosses_dots: bool,
    },
}

impl Pattern {
    /// A pattern of source names.
    pub(super) fn source(text: &str) -> Result<Self, String> {
        let mut pieces = Vec::new();
        let mut rest = text;
        let mut number = 0;
        while let Some((literal, after)) = rest.split_once('*') {
            push_literal(&mut pieces, literal);
            let crosses_dots = after.starts_with('*');
            rest = after.strip_prefix('*').unwrap_or(after);
            if number == MAX_WILDCARDS {
                return Err(format!("more than {MAX_WILDCARDS} wildcards in {text:?}"));
            }
            pieces.push(Piece::Wildcard { number, crosses_dots });
            number += 1;
        }
        push_literal(&mut pieces, rest);
        Self { pieces }.checked(text)
    }

    /// A pattern of parameter names: `{1}` is what the first wildcard of `source` matched.
    pub(super) fn target(text: &str, source: &Self) -> Result<Self, String> {
        let mut pieces = Vec::new();
        let mut rest = text;
        while let Some((literal, after)) = rest.split_once('{') {
            push_literal(&mut pieces, literal);
            let (inside, after) =
                after.split_once('}').ok_or_else(|| format!("a brace that is not closed in {text:?}"))?;
            let number = inside.parse::<usize>().ok().and_then(|number| number.checked_sub(1));
            let wildcard = number.and_then(|number| source.wildcard(number));
            pieces.push(
                wildcard.ok_or_else(|| format!("{{{inside}}} in {text:?}, for which the source has no wildcard"))?,
            );
            rest = after;
        }
        push_literal(&mut pieces, rest);
        let target = Self { pieces };
        for number in 0..source.wildcards() {
            let uses =
                target.pieces.iter().filter(|piece| matches!(piece, Piece::Wildcard { number: n, .. } if *n == number));
            if uses.count() != 1 {
                return Err(format!("{text:?}, in which {{{}}} does not occur exactly once", number + 1));
            }
        }
        target.checked(text)
    }

    fn checked(self, text: &str) -> Result<Self, String> {
        let adjacent =
            self.pieces.windows(2).any(|pair| pair.iter().all(|piece| matches!(piece, Piece::Wildcard { .. })));
        if self.pieces.is_empty() {
            Err("an empty name".to_owned())
        } else if text.len() > MAX_NAME {
            Err(format!("a name of {} bytes", text.len()))
        } else if adjacent {
            Err(format!("two adjacent wildcards in {text:?}"))
        } else {
            Ok(self)
        }
    }

    fn wildcards(&self) -> usize {
        self.pieces.iter().filter(|piece| matches!(piece, Piece::Wildcard { .. })).count()
    }

    fn wildcard(&self, wanted: usize) -> Option<Piece> {
        self.pieces.iter().find(|piece| matches!(piece, Piece::Wildcard { number, .. } if *number == wanted)).cloned()
    }

    /// What each wildcard matches in `name`, the first as short as possible, then the second, …; `None` if the pattern does
    /// not match.
    pub(super) fn captures<'n>(&self, name: &'n str) -> Option<Vec<&'n str>> {
        let mut captures = vec![""; self.wildcards()];
        let matched = name.len() <= MAX_NAME && capture(&self.pieces, name, &mut captures);
        matched.then_some(captures)
    }

    /// The name with wildcards filled in.
    pub(super) fn filled(&self, captures: &[&str]) -> String {
        let piece = |piece: &Piece| match piece {
            Piece::Literal(text) => text.clone(),
            Piece::Wildcard { number, .. } => captures[*number].to_owned(),
        };
        self.pieces.iter().map(piece).collect()
    }
}

fn push_literal(pieces: &mut Vec<Piece>, literal: &str) {
    if !literal.is_empty() {
        pieces.push(Piece::Literal(literal.to_owned()));
    }
}

fn capture<'n>(pieces: &[Piece], name: &'n str, captures: &mut [&'n str]) -> bool {
    let Some((piece, pieces)) = pieces.split_first() else { return name.is_empty() };
    match piece {
        Piece::Literal(text) => name.strip_prefix(text.as_str()).is_some_and(|rest| capture(pieces, rest, captures)),
        Piece::Wildcard { number, crosses_dots } => {
            let ends = name.char_indices().map(|(at, c)| (at + c.len_utf8(), c));
            for (end, c) in ends {
                if c == '.' && !crosses_dots {
                    return false;
                }
                let (taken, rest) = name.split_at(end);
                if capture(pieces, rest, captures) {
                    captures[*number] = taken;
                    return true;
                }
            }
            false
        }
    }
}

impl fmt::Display for Pattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.pieces.iter().try_for_each(|piece| match piece {
            Piece::Literal(text) => f.write_str(text),
            Piece::Wildcard { crosses_dots, .. } => f.write_str(if *crosses_dots { "**" } else { "*" }),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_matched_and_wildcards_filled_in() {
        let source = Pattern::source("encoder.layer.*.norm1.**").unwrap();
        let target = Pattern::target("blocks.{1}.norm1.{2}", &source).unwrap();
        let captures = source.captures("encoder.layer.11.norm1.weight.v").unwrap();
        assert_eq!(captures, ["11", "weight.v"]);
        assert_eq!(target.filled(&captures), "blocks.11.norm1.weight.v");
        assert_eq!(target.captures("blocks.3.norm1.bias").unwrap(), ["3", "bias"], "the inverse");
        for other in ["encoder.layer.1.2.norm1.bias", "encoder.layer..norm1.bias", "encoder.layer.1.norm1.", "x"] {
            assert!(source.captures(other).is_none(), "{other}");
        }
        let swapped = Pattern::target("{2}.{1}", &source).unwrap();
        assert_eq!(swapped.captures("b.5").unwrap(), ["5", "b"]);
        assert_eq!(source.to_string(), "encoder.layer.*.norm1.**");
    }

    #[test]
    fn errors_of_invalid_patterns_give_the_reason() {
        let source = Pattern::source("a.*").unwrap();
        for (text, expected) in [
            ("b", "{1} does not occur exactly once"),
            ("b.{1}.{1}", "exactly once"),
            ("b.{2}", "{2}"),
            ("b.{0}", "{0}"),
            ("b.{x}", "{x}"),
            ("b.{1", "not closed"),
        ] {
            let error = Pattern::target(text, &source).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
        for text in ["", "***", "a*.*.*.*"] {
            Pattern::source(text).unwrap_err();
        }
    }

    #[test]
    fn matching_is_not_slow() {
        let nasty = Pattern::source("**a**a**b").unwrap();
        assert!(nasty.captures(&"a".repeat(MAX_NAME)).is_none());
        assert!(nasty.captures(&"a".repeat(MAX_NAME + 1)).is_none());
    }
}
