use atsplat_files::escaped_markdown as escaped;
use atsplat_numeric::decimals_of_interval;

use crate::numbers::signed;
use crate::table::{Outcome, Table};

/// Every pair of published rows that the tables reproduce under one protocol, in GitHub's Markdown: what the paper measured,
/// what was measured here with its paired interval, and whether the order is the same. `None` if there is no such pair.
pub fn orders_as_markdown(tables: &[Table]) -> Option<String> {
    let sections: Vec<String> = tables.iter().filter(|table| !table.orders.is_empty()).map(section).collect();
    (!sections.is_empty()).then(|| {
        format!(
            "## Published orders\n\nA difference is the first row's mean minus the second's. Its 95 % interval is paired over scenes, and over \
             trainings where a row has several. An order is kept or reversed if the whole interval is on one side of zero.\n\n{}",
            sections.join("\n")
        )
    })
}

fn section(table: &Table) -> String {
    let mut text = format!(
        "### {}\n\n| first | second | | published | measured | interval | scenes | trainings | order |\n\
         | --- | --- | --- | ---: | ---: | --- | ---: | --- | --- |\n",
        escaped(&table.title)
    );
    for order in &table.orders {
        let [first, second] = order.rows.each_ref().map(|row| escaped(row));
        let decimals = decimals_of_interval(order.interval, 3);
        let interval = match order.interval {
            Some([low, high]) => format!("\\[{}, {}\\]", signed(low, decimals), signed(high, decimals)),
            None => "none: too few scenes".to_owned(),
        };
        let [one, other] = order.trainings;
        let outcome = match order.outcome {
            Outcome::Kept => "kept",
            Outcome::Reversed => "**reversed**",
            Outcome::Undecided => "undecided",
        };
        text.push_str(&format!(
            "| {first} | {second} | {} | {} | {} | {interval} | {} | {one} and {other} | {outcome}{}{} |\n",
            escaped(order.quantity),
            signed(order.published, 3),
            signed(order.measured, decimals),
            order.scenes,
            if order.inference_only { ", changed at inference only" } else { "" },
            if order.untrained { ", untrained" } else { "" },
        ));
    }
    text
}
