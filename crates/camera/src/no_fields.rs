use serde::{Deserialize, Deserializer};

/// Rejects fields next to the tag of a variant without fields, which serde would ignore; for `deserialize_with`.
///
/// # Errors
/// That of the deserializer for an unknown field.
pub fn no_fields<'de, D: Deserializer<'de>>(table: D) -> Result<(), D::Error> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(
        clippy::empty_structs_with_brackets,
        reason = "without them, it would be read from a unit and not from a table"
    )]
    struct Nothing {}
    Nothing::deserialize(table).map(|Nothing {}| ())
}
