/// `count` of `all` positions, evenly spread and including the first: `⌊k · all / count⌋`; all of them if `count ≥ all`.
pub fn spread(all: usize, count: usize) -> Vec<usize> {
    if count >= all {
        return (0..all).collect();
    }
    (0..count).map(|k| k * all / count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_spread_evenly() {
        assert_eq!(spread(10, 4), [0, 2, 5, 7]);
        assert_eq!(spread(3, 5), [0, 1, 2]);
        assert_eq!((spread(5, 0), spread(0, 3)), (vec![], vec![]));
    }
}
