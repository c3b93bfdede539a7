use atsplat_files::quoted;

use super::Malformed;
use super::binary::slots;
use super::header::{Element, Kind, Scalar};

/// Reader of rows in text encoding.
pub(super) struct Text<'a> {
    rest: &'a [u8],
    /// Lines of the file before `rest`.
    lines: usize,
}

impl<'a> Text<'a> {
    pub(super) const fn new(rest: &'a [u8], lines: usize) -> Self {
        Self { rest, lines }
    }

    pub(super) const fn remaining(&self) -> usize {
        self.rest.len()
    }

    /// Number of the first remaining line that is not blank, and the count of such lines; `None` if there are none.
    pub(super) fn trailing_rows(&self) -> Option<(usize, usize)> {
        let mut lines =
            self.rest.split(|byte| *byte == b'\n').enumerate().filter(|(_, line)| !line.trim_ascii().is_empty());
        let (first, _) = lines.next()?;
        Some((self.lines + first + 1, 1 + lines.count()))
    }

    /// Bytes of the shortest row: one digit and one separator per property.
    pub(super) fn smallest_row(element: &Element<'_>) -> usize {
        2 * element.properties.len()
    }

    pub(super) fn rows(
        &mut self,
        element: &Element<'_>,
        requested: &[usize],
        mut take: impl FnMut(&[f64]),
    ) -> Result<(), Malformed> {
        if element.properties.is_empty() {
            return Ok(());
        }
        let slots = slots(element, requested);
        let mut values = vec![0.0; requested.len()];
        for _ in 0..element.count {
            let line = self.line()?;
            let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
            for (property, slot) in element.properties.iter().zip(&slots) {
                match property.kind {
                    Kind::Scalar(scalar) => {
                        let number = self.number(scalar, words.next())?;
                        if let Some(value) = slot.and_then(|slot| values.get_mut(slot)) {
                            *value = number;
                        }
                    }
                    Kind::List { length, item } => {
                        let mut left = self.number(length, words.next())?;
                        if left < 0.0 {
                            return Err(self.malformed("a non-negative list length", &left.to_string()));
                        }
                        while left > 0.0 {
                            self.number(item, words.next())?;
                            left -= 1.0;
                        }
                    }
                }
            }
            if let Some(word) = words.next() {
                return Err(self.malformed("the end of the line", &quoted(word)));
            }
            take(&values);
        }
        Ok(())
    }

    /// The next line that is not blank.
    fn line(&mut self) -> Result<&'a [u8], Malformed> {
        while !self.rest.is_empty() {
            let length = self.rest.iter().position(|byte| *byte == b'\n');
            let (line, rest) = self.rest.split_at(length.map_or(self.rest.len(), |length| length + 1));
            self.rest = rest;
            self.lines += 1;
            let line = line.trim_ascii();
            if !line.is_empty() {
                return Ok(line);
            }
        }
        Err(self.malformed("a row", "the end of the file"))
    }

    /// Parses as the property's own type: rounding a decimal to f64 and then to f32 may miss the f32 that was written.
    fn number(&self, scalar: Scalar, word: Option<&[u8]>) -> Result<f64, Malformed> {
        let word = word.ok_or_else(|| self.malformed("another number", "the end of the line"))?;
        let text = str::from_utf8(word).map_err(|_not_text| self.malformed("text", &quoted(word)))?;
        let number = match scalar {
            Scalar::F32 => text.parse::<f32>().ok().map(f64::from),
            Scalar::F64 => text.parse().ok(),
            Scalar::I8 => text.parse::<i8>().ok().map(f64::from),
            Scalar::U8 => text.parse::<u8>().ok().map(f64::from),
            Scalar::I16 => text.parse::<i16>().ok().map(f64::from),
            Scalar::U16 => text.parse::<u16>().ok().map(f64::from),
            Scalar::I32 => text.parse::<i32>().ok().map(f64::from),
            Scalar::U32 => text.parse::<u32>().ok().map(f64::from),
        };
        number.ok_or_else(|| self.malformed(&format!("a number of type {scalar:?}"), &quoted(word)))
    }

    fn malformed(&self, expected: &str, found: &str) -> Malformed {
        Malformed::new(format!("line {}", self.lines), expected, found)
    }
}
