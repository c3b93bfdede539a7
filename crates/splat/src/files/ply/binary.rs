use super::Malformed;
use super::header::{Element, Kind, Property, Scalar};

/// Reader of rows in binary encoding.
pub(super) struct Binary<'a> {
    rest: &'a [u8],
    /// Byte of the file at which `rest` starts.
    at: usize,
    big_endian: bool,
}

impl<'a> Binary<'a> {
    pub(super) const fn new(rest: &'a [u8], at: usize, big_endian: bool) -> Self {
        Self { rest, at, big_endian }
    }

    pub(super) const fn remaining(&self) -> usize {
        self.rest.len()
    }

    /// Offset and number of the bytes after the last row; `None` if there are none.
    pub(super) fn trailing_bytes(&self) -> Option<(usize, usize)> {
        (!self.rest.is_empty()).then_some((self.at, self.rest.len()))
    }

    /// Bytes of a row with empty lists.
    pub(super) fn smallest_row(element: &Element<'_>) -> usize {
        let size = |kind| match kind {
            Kind::Scalar(scalar) | Kind::List { length: scalar, .. } => Scalar::size(scalar),
        };
        element.properties.iter().map(|property| size(property.kind)).sum()
    }

    pub(super) fn rows(
        &mut self,
        element: &Element<'_>,
        requested: &[usize],
        take: impl FnMut(&[f64]),
    ) -> Result<(), Malformed> {
        let is_list = |property: &Property<'_>| matches!(property.kind, Kind::List { .. });
        if element.properties.iter().any(is_list) {
            self.rows_with_lists(element, requested, take)
        } else {
            self.fixed_size_rows(element, requested, take)
        }
    }

    fn fixed_size_rows(
        &mut self,
        element: &Element<'_>,
        requested: &[usize],
        mut take: impl FnMut(&[f64]),
    ) -> Result<(), Malformed> {
        let size = Self::smallest_row(element);
        let total = usize::try_from(element.count).ok().and_then(|count| count.checked_mul(size));
        // Rows without properties take no bytes, however many there are.
        let bytes = self.bytes(if size == 0 { 0 } else { total.unwrap_or(usize::MAX) })?;
        if requested.is_empty() || size == 0 {
            return Ok(());
        }
        let mut end = 0;
        let place = |property: &Property<'_>| match property.kind {
            Kind::Scalar(scalar) => {
                let start = end;
                end += scalar.size();
                Some((start, scalar))
            }
            Kind::List { .. } => None,
        };
        let places: Vec<(usize, Scalar)> = element.properties.iter().filter_map(place).collect();
        let columns: Vec<(usize, Scalar)> =
            requested.iter().filter_map(|property| places.get(*property).copied()).collect();
        let mut values = vec![0.0; columns.len()];
        for row in bytes.chunks_exact(size) {
            for (value, (offset, scalar)) in values.iter_mut().zip(&columns) {
                *value = self.number(*scalar, row, *offset);
            }
            take(&values);
        }
        Ok(())
    }

    fn rows_with_lists(
        &mut self,
        element: &Element<'_>,
        requested: &[usize],
        mut take: impl FnMut(&[f64]),
    ) -> Result<(), Malformed> {
        let slots = slots(element, requested);
        let mut values = vec![0.0; requested.len()];
        for _ in 0..element.count {
            for (property, slot) in element.properties.iter().zip(&slots) {
                match property.kind {
                    Kind::Scalar(scalar) => {
                        let number = self.next_number(scalar)?;
                        if let Some(value) = slot.and_then(|slot| values.get_mut(slot)) {
                            *value = number;
                        }
                    }
                    Kind::List { length, item } => {
                        let at = self.at;
                        let count = self.next_number(length)?;
                        if count < 0.0 {
                            return Err(Malformed::new(
                                format!("byte {at}"),
                                "a non-negative list length",
                                count.to_string(),
                            ));
                        }
                        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 ≤ count < 2³²")]
                        self.bytes((count as usize).saturating_mul(item.size()))?;
                    }
                }
            }
            take(&values);
        }
        Ok(())
    }

    fn bytes(&mut self, count: usize) -> Result<&'a [u8], Malformed> {
        let Some((taken, rest)) = self.rest.split_at_checked(count) else {
            let found = format!("{} bytes", self.rest.len());
            return Err(Malformed::new(format!("byte {}", self.at), format!("{count} bytes"), found));
        };
        self.rest = rest;
        self.at += count;
        Ok(taken)
    }

    fn next_number(&mut self, scalar: Scalar) -> Result<f64, Malformed> {
        let bytes = self.bytes(scalar.size())?;
        Ok(self.number(scalar, bytes, 0))
    }

    /// The number at `offset`; every type converts exactly to f64.
    #[inline]
    fn number(&self, scalar: Scalar, bytes: &[u8], offset: usize) -> f64 {
        macro_rules! decoded {
            ($number:ty) => {{
                let bytes = bytes.get(offset..).and_then(<[u8]>::first_chunk);
                let bytes = *bytes.expect("a row contains all its properties");
                let number =
                    if self.big_endian { <$number>::from_be_bytes(bytes) } else { <$number>::from_le_bytes(bytes) };
                f64::from(number)
            }};
        }
        match scalar {
            Scalar::I8 => decoded!(i8),
            Scalar::U8 => decoded!(u8),
            Scalar::I16 => decoded!(i16),
            Scalar::U16 => decoded!(u16),
            Scalar::I32 => decoded!(i32),
            Scalar::U32 => decoded!(u32),
            Scalar::F32 => decoded!(f32),
            Scalar::F64 => decoded!(f64),
        }
    }
}

/// For each property of an element, its index in `requested`.
pub(super) fn slots(element: &Element<'_>, requested: &[usize]) -> Vec<Option<usize>> {
    let mut slots = vec![None; element.properties.len()];
    for (at, property) in requested.iter().enumerate() {
        slots[*property] = Some(at);
    }
    slots
}
