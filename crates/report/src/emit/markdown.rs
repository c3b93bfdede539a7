use atsplat_files::escaped_markdown as escaped;

use crate::table::{Cell, Column, Mark, Table};

/// A heading, a table in GitHub's Markdown, and the notes as a list. Column headings include the group: `PSNR ↑, 2 views`.
pub(super) fn write(table: &Table) -> String {
    let measured = table.is_measured();
    let mut heads: Vec<String> = table.labels.iter().map(|label| escaped(label)).collect();
    heads.extend(measured.then(|| "measured on".to_owned()));
    let names = heads.len();
    for (index, column) in table.columns() {
        let title = &table.groups[index.group].title;
        let head = if title.is_empty() { column.head() } else { format!("{}, {title}", column.head()) };
        heads.push(escaped(&head));
    }
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let mut text = format!("### {}\n\n{}\n\n", escaped(&table.title), escaped(&table.caption));
    text.push_str(&line(&heads));
    let align: Vec<String> = (0..heads.len()).map(|at| if at < names { "---" } else { "---:" }.to_owned()).collect();
    text.push_str(&line(&align));
    for row in &table.rows {
        let mut cells: Vec<String> = row.printed_labels().iter().map(|label| escaped(label)).collect();
        cells.extend(measured.then(|| escaped(row.origin_text())));
        cells.extend(table.columns().map(|(index, column)| number(row.cell(index), column)));
        text.push_str(&line(&cells));
    }
    text.push('\n');
    for note in &table.footer {
        text.push_str(&format!("- {}\n", escaped(&note.text)));
    }
    text
}

fn number(cell: &Cell, column: &Column) -> String {
    let text = escaped(&cell.print(column));
    match cell.mark {
        Mark::Best => format!("**{text}**"),
        Mark::Second => format!("<u>{text}</u>"),
        Mark::Plain => text,
    }
}
