//! Parses numbers and columns of text from bytes.

/// Powers of ten that an f64 represents exactly.
const EXACT_POWERS: [f64; 20] =
    [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19];

/// Up to here every integer is an f64.
const EXACT_INTEGERS: u64 = 1 << 53;

/// Parses like `str::parse::<f64>`, bit for bit, but several times faster for the short decimals of datasets.
pub(crate) fn parse_f64(token: &[u8]) -> Option<f64> {
    short_decimal(token).or_else(|| std::str::from_utf8(token).ok()?.parse().ok())
}

/// Parses like `str::parse::<i64>`.
pub(crate) fn parse_i64(token: &[u8]) -> Option<i64> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// Parses like `str::parse::<u64>`.
pub(crate) fn parse_u64(token: &[u8]) -> Option<u64> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// Clinger's fast path: a mantissa below 2⁵³ and a power of ten below 10²² are both exact, so that their quotient is
/// correctly rounded. `None` means that the fast path does not apply, not that the token is not a number.
#[inline]
fn short_decimal(token: &[u8]) -> Option<f64> {
    let (negative, digits) = match token {
        [b'-', rest @ ..] => (true, rest),
        _ => (false, token),
    };
    // 19 digits stay below 2⁶⁴.
    if digits.len() >= EXACT_POWERS.len() {
        return None;
    }
    let (mut mantissa, mut point) = (0u64, None);
    for (at, byte) in digits.iter().enumerate() {
        match byte {
            b'0'..=b'9' => mantissa = mantissa * 10 + u64::from(byte - b'0'),
            b'.' if point.is_none() => point = Some(at),
            _ => return None,
        }
    }
    let decimals = point.map_or(0, |at| digits.len() - at - 1);
    let has_digits = digits.len() > usize::from(point.is_some());
    if !has_digits || mantissa > EXACT_INTEGERS {
        return None;
    }
    let magnitude = mantissa as f64 / EXACT_POWERS.get(decimals)?;
    Some(if negative { -magnitude } else { magnitude })
}

/// Splits a line at runs of spaces and tabs; a carriage return (Windows line ends) counts as a space.
#[derive(Clone, Debug)]
pub(crate) struct Columns<'a> {
    rest: &'a [u8],
}

impl<'a> Columns<'a> {
    pub(crate) const fn of(line: &'a [u8]) -> Self {
        Self { rest: line }
    }

    /// The rest of the line, trimmed.
    pub(crate) fn rest(&self) -> &'a [u8] {
        self.rest.trim_ascii()
    }
}

impl<'a> Iterator for Columns<'a> {
    type Item = &'a [u8];

    #[inline]
    fn next(&mut self) -> Option<&'a [u8]> {
        let start = self.rest.iter().position(|byte| !is_blank(*byte))?;
        let token = self.rest.get(start..)?;
        let end = token.iter().position(|byte| is_blank(*byte)).unwrap_or(token.len());
        let (token, rest) = token.split_at(end);
        self.rest = rest;
        Some(token)
    }
}

const fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\r')
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn assert_like_std(text: &str) {
        let std = text.parse::<f64>().ok().map(f64::to_bits);
        let ours = parse_f64(text.as_bytes()).map(f64::to_bits);
        assert_eq!(ours, std, "{text:?}");
    }

    #[test]
    fn unusual_notations_parse_as_with_std() {
        let texts = "|-|+|.|-.|5.|.5|+.5|-0|-0.0|1e5|1E-5|1e|inf|-NaN|infinity|1_0|0x10|1..2|1.2.3|--1\
            |9007199254740993|9007199254740993.0|9999999999999999999|1e400|1 \
            |0.000000000000000000001|184467440737095516150|0.9999999999999999999";
        for text in texts.split('|') {
            assert_like_std(text);
        }
    }

    #[test]
    fn invalid_utf8_and_other_digits_are_not_numbers() {
        assert_eq!(parse_f64(&[0xff, b'1']), None);
        assert_eq!(parse_f64("١".as_bytes()), None);
    }

    #[test]
    fn columns_are_split_at_runs_of_blanks_and_carriage_returns() {
        let columns: Vec<_> = Columns::of(b"  a\t b  c \r").collect();
        assert_eq!(columns, [b"a", b"b", b"c"]);
        let mut two = Columns::of(b"1 2  name with spaces.png \r");
        assert_eq!((two.next(), two.next()), (Some(&b"1"[..]), Some(&b"2"[..])));
        assert_eq!(two.rest(), b"name with spaces.png");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4096))]

        #[test]
        fn decimals_parse_as_with_std(text in "[-+]?[0-9]{0,21}[.]?[0-9]{0,21}([eE][-+]?[0-9]{1,3})?") {
            assert_like_std(&text);
        }

        #[test]
        fn printed_floats_round_trip(value in prop::num::f64::ANY) {
            assert_like_std(&format!("{value}"));
            assert_like_std(&format!("{value:.9}"));
            assert_like_std(&format!("{value:e}"));
        }

        #[test]
        fn any_bytes_parse_as_with_std(bytes in prop::collection::vec(any::<u8>(), 0..24)) {
            let std = std::str::from_utf8(&bytes).ok().and_then(|text| text.parse::<f64>().ok()).map(f64::to_bits);
            prop_assert_eq!(parse_f64(&bytes).map(f64::to_bits), std);
        }
    }
}
