use super::cite::citation;
use super::{PageStore, escaped};
use crate::plot::Origin;
use crate::table::{Mark, NoteKind, Row, Table, agreement};

/// Tables with more columns are set more tightly.
const WIDE: usize = 11;

/// Every table as a card.
pub(super) fn write(tables: &[Table], stores: &[PageStore<'_>]) -> String {
    tables.iter().map(|table| card(table, &region(table, tables), stores)).collect()
}

/// The name of a table's region; tables of one title, as of several protocols, would share it.
fn region(table: &Table, tables: &[Table]) -> String {
    let twins = tables.iter().filter(|other| other.title == table.title).count();
    if twins > 1 { format!("{} ({})", table.title, table.name) } else { table.title.clone() }
}

/// A table alone, without buttons and style, as notebooks show it.
pub fn table_html(table: &Table) -> String {
    let notes: String = table.footer.iter().map(|note| format!("<li>{}</li>", escaped(&note.text))).collect();
    format!(
        "<p><strong>{}</strong><br>{}</p>{}<details><summary>Convention, counts, intervals</summary><ul>{notes}</ul></details>",
        escaped(&table.title),
        escaped(&table.caption),
        body(table, &[]),
    )
}

fn card(table: &Table, region: &str, stores: &[PageStore<'_>]) -> String {
    let name = escaped(&table.name);
    let buttons: String = [("latex", "LaTeX"), ("markdown", "Markdown"), ("csv", "CSV")]
        .map(|(format, title)| {
            format!("<button type=\"button\" data-table=\"{name}\" data-copy=\"{format}\">Copy {title}</button>")
        })
        .concat();
    let agreement = if table.is_published() && table.is_measured() {
        format!("<p class=\"verdict\">{}</p>", escaped(&agreement(table).to_string()))
    } else {
        String::new()
    };
    let warnings = table.footer.iter().filter(|note| matches!(note.kind, NoteKind::Forced | NoteKind::Busy));
    let warnings: String = warnings.map(|note| format!("<p class=\"warning\">{}</p>", escaped(&note.text))).collect();
    let notes: String = table.footer.iter().map(|note| format!("<li>{}</li>", escaped(&note.text))).collect();
    format!(
        "<article class=\"card\" id=\"table-{name}\">\n<div class=\"top\"><h3>{}</h3><div class=\"tools\">{buttons}</div></div>\n\
         <p class=\"caption\">{}</p>\n{warnings}<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{}\">{}</div>\n{agreement}\n\
         <details class=\"notes\"><summary>Convention, counts, intervals</summary><ul>{notes}</ul></details>\n</article>\n",
        escaped(&table.title),
        escaped(&table.caption),
        escaped(region),
        body(table, stores),
    )
}

fn body(table: &Table, stores: &[PageStore<'_>]) -> String {
    let measured = table.is_measured();
    let labels = table.labels.len() + usize::from(measured);
    // An interval takes as much room as another number.
    let wanted: usize = table.columns().map(|(_, column)| 1 + usize::from(column.intervals)).sum();
    let wide = if labels + wanted > WIDE { " wide" } else { "" };
    let mut text = format!("<table class=\"numbers{wide}\"><thead>");
    if table.groups.iter().any(|group| !group.title.is_empty()) {
        let groups = table.groups.iter().map(|group| {
            let (columns, title) = (group.columns.len(), escaped(&group.title));
            if title.is_empty() {
                return blank(columns);
            }
            format!("<th class=\"group\" colspan=\"{columns}\" scope=\"colgroup\">{title}</th>")
        });
        text.push_str(&format!("<tr>{}{}</tr>", blank(labels), groups.collect::<String>()));
    }
    text.push_str("<tr>");
    for label in table.labels.iter().map(String::as_str).chain(measured.then_some("from")) {
        text.push_str(&format!("<th class=\"label\" scope=\"col\">{}</th>", escaped(label)));
    }
    for (_, column) in table.columns() {
        text.push_str(&format!("<th scope=\"col\">{}</th>", escaped(&column.head())));
    }
    text.push_str("</tr></thead><tbody>");
    for (at, row) in table.rows.iter().enumerate() {
        let origin = match row.origin {
            Origin::Measured => "measured",
            Origin::Published if measured => "paper",
            Origin::Published => "",
        };
        let rule = if row.rule_above && at > 0 { "rule" } else { "" };
        text.push_str(&format!("<tr class=\"{origin} {rule}\">"));
        for label in &row.printed_labels() {
            text.push_str(&format!("<td class=\"label\">{}</td>", escaped(label)));
        }
        if measured {
            text.push_str(&format!("<td class=\"label\">{}</td>", escaped(row.origin_text())));
        }
        text.push_str(&numbers(table, row, stores));
        text.push_str("</tr>");
    }
    text.push_str("</tbody></table>");
    text
}

/// Columns without a common heading: an empty heading would be read aloud as one.
fn blank(columns: usize) -> String {
    format!("<td colspan=\"{columns}\"></td>")
}

fn numbers(table: &Table, row: &Row, stores: &[PageStore<'_>]) -> String {
    let mut text = String::new();
    for (index, column) in table.columns() {
        let cell = row.cell(index);
        let printed = escaped(&cell.print(column));
        // Elements, because notebooks have no style of classes.
        let (mark, printed) = match cell.mark {
            Mark::Best => (" best", format!("<b>{printed}</b>")),
            Mark::Second => (" second", format!("<u>{printed}</u>")),
            Mark::Plain => ("", printed),
        };
        let inside = match citation(table, row, index, stores) {
            Some(citation) => {
                format!("<button type=\"button\" data-cite=\"{}\">{printed}</button>", escaped(&citation))
            }
            None => printed,
        };
        let title = |what: &str, ends: [f64; 2]| {
            let [_, low, high] = column.format_with(0.0, ends).map(|printed| escaped(&printed));
            format!(" title=\"{what} {low} to {high}\"")
        };
        let title = match (&cell.timing, cell.interval) {
            (Some(timing), _) => timing.quartiles().map_or_else(String::new, |ends| title("quartiles", ends)),
            (None, Some(interval)) => title("95 % interval", interval),
            (None, None) => String::new(),
        };
        text.push_str(&format!("<td class=\"number{mark}\"{title}>{inside}</td>"));
    }
    text
}
