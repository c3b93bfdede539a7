//! What several commands ask of their words.

use clap::ValueEnum;

/// Words as on the command line.
pub(crate) fn names<T: ValueEnum>(list: &[T]) -> Vec<String> {
    list.iter().filter_map(T::to_possible_value).map(|value| value.get_name().to_owned()).collect()
}

/// A list in which nothing stands twice.
pub(crate) fn once(word: &str, list: &[String]) -> Result<(), String> {
    let is_known = |(at, item): &(usize, &String)| list.iter().take(*at).any(|before| before == *item);
    match list.iter().enumerate().find(is_known) {
        Some((_, item)) => Err(format!("{word}: {item} is given twice")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twice_is_told_by_name() {
        let list = |words: &str| words.split(',').map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(once("--case", &list("a,b")), Ok(()));
        assert_eq!(once("--case", &list("a,b,a")), Err("--case: a is given twice".to_owned()));
    }
}
