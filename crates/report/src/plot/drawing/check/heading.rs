use super::super::shape::{Drawing, Role, Shape};
use super::{FaultKind, PlotFault, fault};

/// What plots count, in the singular or plural.
const COUNTED: [&str; 11] =
    ["scene", "pair", "clip", "trial", "set", "case", "step", "run", "token", "sample", "acceptance"];
/// Words between a number and what it counts: "24 simulated scenes".
const BETWEEN: usize = 2;

/// A missing title, and a heading without the protocol or data, or without their number.
pub(super) fn faults(drawing: &Drawing) -> Vec<PlotFault> {
    let texts_of = |wanted: Role| -> Vec<&str> {
        let items = drawing.items.iter().filter(move |item| item.role == wanted);
        items
            .filter_map(|item| if let Shape::Text(text) = &item.shape { Some(text.text.as_str()) } else { None })
            .collect()
    };
    let (title, subtitle) = (texts_of(Role::Title).join(" "), texts_of(Role::Subtitle).join(" "));
    let mut faults = Vec::new();
    let mut missing = |what: &str| faults.push(fault(FaultKind::Heading, format!("{what}: “{title}”, “{subtitle}”")));
    if title.trim().is_empty() {
        missing("no title");
    }
    if subtitle.split([',', ';']).count() < 2 {
        missing("a subtitle names protocol and data");
    }
    if !has_count(&format!("{title}; {subtitle}")) {
        missing("it does not say how many scenes, pairs, clips, cases or steps");
    }
    faults
}

fn has_count(heading: &str) -> bool {
    let words: Vec<&str> =
        heading.split_whitespace().map(|word| word.trim_matches([',', ';', '.', ':', '(', ')'])).collect();
    words.iter().enumerate().any(|(at, word)| {
        let is_number = !word.is_empty() && word.chars().all(|letter| letter.is_ascii_digit());
        is_number
            && words.iter().skip(at + 1).take(BETWEEN + 1).any(|noun| COUNTED.contains(&noun.trim_end_matches('s')))
    })
}
