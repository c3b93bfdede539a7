//! Options that have no effect without another one, where it depends on values: the argument parser cannot express it.

/// An option, and whether it is given.
pub(crate) type GivenOption = (&'static str, bool);

/// Options, and what each of them requires.
#[derive(Debug)]
pub(crate) struct Requirement<'a> {
    pub(crate) options: &'a [GivenOption],
    /// Such as `--formats exr`.
    pub(crate) requires: &'a str,
    pub(crate) satisfied: bool,
}

/// Rejects the first option that is given without what it requires.
pub(crate) fn check_all(requirements: &[Requirement<'_>]) -> Result<(), String> {
    for Requirement { options, requires, .. } in requirements.iter().filter(|requirement| !requirement.satisfied) {
        if let Some((option, _)) = options.iter().find(|(_, given)| *given) {
            return Err(format!("{option} requires {requires}"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_option_without_what_it_requires_is_named() {
        let check = |satisfied: bool, given: bool| {
            check_all(&[
                Requirement { options: &[("--a", true)], requires: "--x", satisfied },
                Requirement { options: &[("--b", false), ("--c", given)], requires: "--y or --z", satisfied: false },
                Requirement { options: &[("--d", true)], requires: "--w", satisfied: true },
            ])
        };
        assert_eq!(check(true, false), Ok(()));
        assert_eq!(check(true, true), Err("--c requires --y or --z".to_owned()));
        assert_eq!(check(false, true), Err("--a requires --x".to_owned()));
    }
}
