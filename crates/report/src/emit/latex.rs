use atsplat_metrics::Direction;

use super::latex_text::{beyond_pdflatex, escaped};
use crate::plot::Origin;
use crate::table::{Mark, NoteKind, Row, Table};

/// Labels of up to this many characters stay on one line.
const ONE_LINE: usize = 32;
/// Words of up to this many characters stay whole.
const WHOLE_WORD: usize = 24;
/// Widths of columns whose text is wrapped.
const LABEL_WIDTH: &str = "p{42mm}";
const ORIGIN_WIDTH: &str = "p{38mm}";

/// A `table` environment, which needs `\usepackage{booktabs,graphicx}`; a table wider than its page is scaled down.
/// Its source, conventions, counts and characters that pdfLaTeX lacks are comments above it; what readers must know to read
/// the numbers is printed: in the rows, the caption, and below the table.
pub(super) fn write(table: &Table) -> String {
    let mut text = String::new();
    for note in table.footer.iter().filter(|note| !is_printed(note.kind)) {
        text.push_str(&format!("% {}\n", comment(&note.text)));
    }
    let comments = text.len();
    let measured = table.is_measured();
    let names = table.labels.len() + usize::from(measured);
    let columns = table.columns().count();
    let grouped = table.groups.iter().any(|group| !group.title.is_empty());
    let wide = if columns > 8 { "*" } else { "" };
    text.push_str(&format!("\\begin{{table{wide}}}[t]\n\\centering\n\\small\n"));
    text.push_str(&format!("\\caption{{\\textbf{{{}.}} {}}}\n", escaped(&table.title), escaped(&table.caption)));
    text.push_str(&format!("\\label{{tab:{}}}\n", label(&table.name)));
    let groups: Vec<String> = table.groups.iter().map(|group| "c".repeat(group.columns.len())).collect();
    let rows: Vec<Vec<String>> = table.rows.iter().map(Row::printed_labels).collect();
    let is_long = |at: usize| rows.iter().any(|labels| labels.get(at).is_some_and(|label| wraps(label)));
    let labels: String = (0..table.labels.len()).map(|at| if is_long(at) { LABEL_WIDTH } else { "l" }).collect();
    let origin = if measured { ORIGIN_WIDTH } else { "" };
    text.push_str("\\resizebox{\\ifdim\\width>\\linewidth\\linewidth\\else\\width\\fi}{!}{");
    text.push_str(&format!("\\begin{{tabular}}{{{labels}{origin} {}}}\n\\toprule\n", groups.join(" ")));
    if grouped {
        text.push_str(&group_heads(table, names));
    }
    let mut heads: Vec<String> = table.labels.iter().map(|label| escaped(label)).collect();
    heads.extend(measured.then(|| "measured on".to_owned()));
    heads.extend(table.columns().map(|(_, column)| {
        let arrow = match column.direction {
            Some(Direction::Higher) => "$\\uparrow$",
            Some(Direction::Lower) => "$\\downarrow$",
            None => "",
        };
        format!("{}{arrow}", escaped(&column.title))
    }));
    text.push_str(&line(&heads));
    text.push_str("\\midrule\n");
    for (at, (row, labels)) in table.rows.iter().zip(&rows).enumerate() {
        if row.rule_above && at > 0 {
            text.push_str("\\midrule\n");
        }
        text.push_str(&line(&cells(table, row, labels, measured)));
    }
    text.push_str("\\bottomrule\n\\end{tabular}}\n");
    let printed: Vec<String> =
        table.footer.iter().filter(|note| is_printed(note.kind)).map(|note| breakable(&note.text)).collect();
    if !printed.is_empty() {
        text.push_str(&format!("\\par\\smallskip{{\\footnotesize {}.\\par}}\n", printed.join(". ")));
    }
    text.push_str(&format!("\\end{{table{wide}}}\n"));
    if let Some(others) = beyond_pdflatex(&text[comments..]) {
        let note = format!("% needs a Unicode engine, XeLaTeX or LuaLaTeX, and a font with {others}\n");
        text.insert_str(comments, &note);
    }
    text
}

/// Whether a note is printed below the table, because a number is misread without it.
const fn is_printed(kind: NoteKind) -> bool {
    match kind {
        NoteKind::Source | NoteKind::Convention | NoteKind::Counts | NoteKind::Interval | NoteKind::Choice => false,
        NoteKind::Published
        | NoteKind::Stated
        | NoteKind::Machine
        | NoteKind::Setting
        | NoteKind::Untrained
        | NoteKind::NotComputed
        | NoteKind::Busy
        | NoteKind::TimeScope
        | NoteKind::Unranked
        | NoteKind::Forced
        | NoteKind::Trend
        | NoteKind::LeftOut
        | NoteKind::Paired
        | NoteKind::Trainings => true,
    }
}

fn group_heads(table: &Table, names: usize) -> String {
    let mut heads = vec![String::new(); names];
    let mut rules = String::new();
    let mut at = names + 1;
    for group in &table.groups {
        let count = group.columns.len();
        heads.push(format!("\\multicolumn{{{count}}}{{c}}{{{}}}", escaped(&group.title)));
        if !group.title.is_empty() {
            rules.push_str(&format!("\\cmidrule(lr){{{at}-{}}}", at + count - 1));
        }
        at += count;
    }
    format!("{}{rules}\n", line(&heads))
}

fn wraps(label: &str) -> bool {
    label.chars().count() > ONE_LINE
}

/// Escapes text whose long words, such as the names of checkpoints, may break after punctuation.
fn breakable(text: &str) -> String {
    let word = |word: &str| {
        if word.chars().count() <= WHOLE_WORD {
            return escaped(word);
        }
        word.split_inclusive(['_', '-', '/', '.', ':']).map(escaped).collect::<Vec<_>>().join("\\allowbreak{}")
    };
    text.split(' ').map(word).collect::<Vec<_>>().join(" ")
}

fn cells(table: &Table, row: &Row, labels: &[String], measured: bool) -> Vec<String> {
    let label = |label: &String| {
        if wraps(label) { format!("\\raggedright {}", breakable(label)) } else { escaped(label) }
    };
    let mut cells: Vec<String> = labels.iter().map(label).collect();
    let origin = match row.origin {
        Origin::Published => "paper".to_owned(),
        Origin::Measured => format!("\\scriptsize\\raggedright {}", breakable(row.origin_text())),
    };
    cells.extend(measured.then_some(origin));
    cells.extend(table.columns().map(|(index, column)| {
        let cell = row.cell(index);
        let text = escaped(&cell.print(column));
        match cell.mark {
            Mark::Best => format!("\\textbf{{{text}}}"),
            Mark::Second => format!("\\underline{{{text}}}"),
            Mark::Plain => text,
        }
    }));
    cells
}

/// A row. Its end is not `\\`, to which `\raggedright` gives another meaning.
fn line(cells: &[String]) -> String {
    // The rule or row above would take a bracket or star as its argument.
    let is_argument = cells.first().is_some_and(|cell| cell.trim_start().starts_with(['[', '*']));
    let guard = if is_argument { "{}" } else { "" };
    format!("{guard}{} \\tabularnewline\n", cells.join(" & "))
}

/// Replaces control characters, because a line break would end the comment.
fn comment(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect()
}

fn label(name: &str) -> String {
    name.chars().filter(|letter| letter.is_ascii_alphanumeric() || *letter == '_' || *letter == '-').collect()
}
