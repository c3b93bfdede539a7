//! How a record of weights describes the data of all its trainings: `1 × rooms + 2 × yards; before: other data`, from the last
//! training back to the first.

/// Between the sources of one training.
const AND: &str = " + ";
/// Precedes the data of the weights from which a training began.
const BEFORE: &str = "; before: ";

/// The description of one training's data, from its sources' descriptions.
pub fn of_sources(sources: impl IntoIterator<Item = String>) -> String {
    sources.into_iter().collect::<Vec<_>>().join(AND)
}

/// The description of a training's data, and of that of the weights from which it began; or what is recorded of an import, and of the one
/// before it.
pub fn continued(data: &str, before: &str) -> String {
    format!("{data}{BEFORE}{before}")
}

/// The descriptions of single trainings, the last one first.
pub fn trainings(description: &str) -> impl Iterator<Item = &str> {
    description.split(BEFORE)
}

/// The descriptions of the sources of a single training.
pub fn sources_of(training: &str) -> impl Iterator<Item = &str> {
    training.split(AND)
}

/// The descriptions of the sources of all trainings.
pub fn sources(description: &str) -> impl Iterator<Item = &str> {
    trainings(description).flat_map(sources_of)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_description_is_read_as_it_was_written() {
        let last = of_sources(["1 × rooms".to_owned(), "2 × yards".to_owned()]);
        let description = continued(&last, "photographs");
        assert_eq!(description, "1 × rooms + 2 × yards; before: photographs");
        assert_eq!(trainings(&description).collect::<Vec<_>>(), ["1 × rooms + 2 × yards", "photographs"]);
        assert_eq!(sources_of(&last).collect::<Vec<_>>(), ["1 × rooms", "2 × yards"]);
        assert_eq!(sources(&description).collect::<Vec<_>>(), ["1 × rooms", "2 × yards", "photographs"]);
    }
}
