use std::collections::BTreeMap;

/// The methods that a plot against a cost has no point of, each reason with its methods:
/// `No point against time: nearest view (no Gaussians).`
pub(super) fn without_point(cost: &str, left_out: impl IntoIterator<Item = (String, String)>) -> Vec<String> {
    let mut by_reason: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (why, title) in left_out {
        by_reason.entry(why).or_default().push(title);
    }
    let line =
        |(why, titles): (String, Vec<String>)| format!("No point against {cost}: {} ({why}).", titles.join(", "));
    by_reason.into_iter().map(line).collect()
}
