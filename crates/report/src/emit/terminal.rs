use unicode_width::UnicodeWidthStr as _;

use crate::plot::Origin;
use crate::table::{CellIndex, Mark, Row, Table};

/// Draws tables with box characters for a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Terminal {
    /// Width of the terminal in characters. A wider table is split between groups of columns, or else between columns.
    pub width: usize,
    /// Whether the best value is bold, the second underlined and published rows faint, by ANSI escape sequences;
    /// otherwise `*` and `_` follow the numbers.
    pub styled: bool,
}

const BOLD: &str = "\u{1b}[1m";
const UNDERLINE: &str = "\u{1b}[4m";
const FAINT: &str = "\u{1b}[2m";
const PLAIN: &str = "\u{1b}[0m";

/// A cell as it is printed.
#[derive(Clone, Default)]
struct Text {
    text: String,
    mark: Mark,
}

/// Columns that are shown together: headings, and a text per row.
struct Part {
    groups: Vec<(String, usize)>,
    heads: Vec<String>,
    rows: Vec<Vec<Text>>,
}

impl Part {
    fn widths(&self) -> Vec<usize> {
        let texts = |at: usize| self.rows.iter().map(move |row| row[at].text.width());
        let heads = self.heads.iter().enumerate();
        heads.map(|(at, head)| texts(at).fold(head.width(), usize::max)).collect()
    }
}

impl Terminal {
    /// The table as text.
    pub fn write(&self, table: &Table) -> String {
        let mut text = format!("{}\n", self.with_style(&clean(&table.title), BOLD));
        for line in wrapped(&clean(&table.caption), self.width) {
            text.push_str(&format!("{line}\n"));
        }
        let headers = self.row_headers(table);
        for part in self.parts(table, &headers) {
            text.push_str(&self.part(table, &headers, &part));
        }
        if !self.styled
            && table.rows.iter().flat_map(|row| row.cells.iter().flatten()).any(|cell| cell.mark != Mark::Plain)
        {
            text.push_str("  * best, _ second\n");
        }
        for note in &table.footer {
            for (at, line) in wrapped(&clean(&note.text), self.width.saturating_sub(4)).iter().enumerate() {
                let lead = if at == 0 { "  " } else { "    " };
                text.push_str(&format!("{lead}{}\n", self.with_style(line, FAINT)));
            }
        }
        text
    }

    fn with_style(&self, text: &str, style: &str) -> String {
        if self.styled { format!("{style}{text}{PLAIN}") } else { text.to_owned() }
    }

    /// Labels and origin of each row, in lines that leave room for the widest column.
    fn row_headers(&self, table: &Table) -> Vec<Header> {
        const LONGEST: usize = 26;
        const SHORTEST: usize = 8;
        let widest = table.columns().map(|(index, _)| self.width_of(table, &[index])).max().unwrap_or(0);
        let fits = |headers: &Vec<Header>| width_of_headers(headers) + widest <= self.width;
        let mut shorter = (SHORTEST..=LONGEST).rev().map(|longest| row_headers(table, longest));
        shorter.find(fits).unwrap_or_else(|| row_headers(table, SHORTEST))
    }

    /// Splits the columns into parts that fit the width after these headers of rows.
    fn parts(&self, table: &Table, headers: &[Header]) -> Vec<Part> {
        let columns: Vec<CellIndex> = table.columns().map(|(index, _)| index).collect();
        let lead = width_of_headers(headers);
        let fits = |columns: &[CellIndex]| lead + self.width_of(table, columns) <= self.width;
        let mut parts: Vec<Vec<CellIndex>> = Vec::new();
        let mut part: Vec<CellIndex> = Vec::new();
        for group in columns.chunk_by(|a, b| a.group == b.group) {
            if !part.is_empty() && !fits(&[&part[..], group].concat()) {
                parts.push(std::mem::take(&mut part));
            }
            for index in group {
                if !part.is_empty() && !fits(&[&part[..], &[*index][..]].concat()) {
                    parts.push(std::mem::take(&mut part));
                }
                part.push(*index);
            }
        }
        parts.push(part);
        parts.iter().map(|columns| self.part_of(table, columns)).collect()
    }

    /// The characters of columns with the borders after them; a group's heading may be wider than its columns.
    fn width_of(&self, table: &Table, columns: &[CellIndex]) -> usize {
        let part = self.part_of(table, columns);
        let widths = part.widths();
        let mut widths = widths.iter();
        let of_group = |(title, count): &(String, usize)| {
            let together: usize = widths.by_ref().take(*count).map(|width| width + 3).sum();
            together.max(title.width() + 3)
        };
        part.groups.iter().map(of_group).sum()
    }

    fn part_of(&self, table: &Table, columns: &[CellIndex]) -> Part {
        let text = |row: &Row, index: &CellIndex| {
            let cell = row.cell(*index);
            let sign = match cell.mark {
                _ if self.styled => "",
                Mark::Best => "*",
                Mark::Second => "_",
                Mark::Plain => "",
            };
            Text { text: format!("{}{sign}", clean(&cell.print(table.column(*index)))), mark: cell.mark }
        };
        let groups = columns.chunk_by(|a, b| a.group == b.group);
        Part {
            groups: groups.map(|group| (clean(&table.groups[group[0].group].title), group.len())).collect(),
            heads: columns.iter().map(|index| clean(&table.column(*index).head())).collect(),
            rows: table.rows.iter().map(|row| columns.iter().map(|index| text(row, index)).collect()).collect(),
        }
    }

    fn part(&self, table: &Table, headers: &[Header], part: &Part) -> String {
        let lead_widths = widths(headers);
        let mut column_widths = part.widths();
        // A group's heading may be wider than its columns.
        let mut at = 0;
        let mut headings = Vec::new();
        for (title, count) in &part.groups {
            let group_widths = &mut column_widths[at..at + count];
            let room = group_widths.iter().sum::<usize>() + 3 * (count - 1);
            group_widths[count - 1] += title.width().saturating_sub(room);
            headings.push(centred(title, group_widths.iter().sum::<usize>() + 3 * count - 1));
            at += count;
        }
        let all: Vec<usize> = lead_widths.iter().chain(&column_widths).copied().collect();
        let rule = |left: char, middle: char, right: char| {
            let cells: Vec<String> = all.iter().map(|width| "─".repeat(width + 2)).collect();
            format!("{left}{}{right}\n", cells.join(&middle.to_string()))
        };
        let mut text = rule('┌', '┬', '┐');
        if part.groups.iter().any(|(title, _)| !title.is_empty()) {
            let cells: Vec<String> = lead_widths.iter().map(|width| " ".repeat(width + 2)).chain(headings).collect();
            text.push_str(&format!("│{}│\n", cells.join("│")));
        }
        let heads = headers.first().into_iter().flatten().map(|head| (head.concat(), false));
        let heads = heads.chain(part.heads.iter().map(|head| (head.clone(), true)));
        let cells: Vec<String> = heads
            .zip(&all)
            .map(|((head, right), width)| self.with_style(&padded(&head, *width, right), BOLD))
            .collect();
        text.push_str(&format!("│ {} │\n", cells.join(" │ ")));
        text.push_str(&rule('├', '┼', '┤'));
        for (at, row) in table.rows.iter().enumerate() {
            if row.rule_above && at > 0 {
                text.push_str(&rule('├', '┼', '┤'));
            }
            let names: Vec<&Vec<String>> = headers.get(at + 1).into_iter().flatten().collect();
            let lines = names.iter().map(|name| name.len()).max().unwrap_or(1);
            let name_at = |line: usize| {
                names.iter().zip(&lead_widths).map(move |(name, width)| {
                    let name = padded(name.get(line).map_or("", String::as_str), *width, false);
                    if row.origin == Origin::Published { self.with_style(&name, FAINT) } else { name }
                })
            };
            let numbers = part.rows.get(at).into_iter().flatten().zip(&column_widths).map(|(number, width)| {
                let space = " ".repeat(width.saturating_sub(number.text.width()));
                let style = match (number.mark, row.origin) {
                    (Mark::Best, _) => BOLD,
                    (Mark::Second, _) => UNDERLINE,
                    (Mark::Plain, Origin::Published) => FAINT,
                    (Mark::Plain, Origin::Measured) => return format!("{space}{}", number.text),
                };
                format!("{space}{}", self.with_style(&number.text, style))
            });
            text.push_str(&format!("│ {} │\n", name_at(0).chain(numbers).collect::<Vec<_>>().join(" │ ")));
            for line in 1..lines {
                let blank = column_widths.iter().map(|width| " ".repeat(*width));
                text.push_str(&format!("│ {} │\n", name_at(line).chain(blank).collect::<Vec<_>>().join(" │ ")));
            }
        }
        text.push_str(&rule('└', '┴', '┘'));
        text
    }
}

/// Labels and origin of a row, each as its lines.
type Header = Vec<Vec<String>>;

/// The headers of all rows, after their headings, with lines of at most so many characters.
fn row_headers(table: &Table, longest: usize) -> Vec<Header> {
    let measured = table.is_measured();
    let origin = |text: &str| measured.then(|| text.to_owned());
    let lines = |text: String| -> Vec<String> {
        wrapped(&clean(&text), longest).iter().map(|line| cut(line, longest)).collect()
    };
    let heads = table.labels.iter().cloned().chain(origin("measured on")).map(|head| vec![clean(&head)]).collect();
    let row = |row: &Row| {
        let names = row.printed_labels().into_iter();
        names.chain(origin(row.origin_text())).map(lines).collect()
    };
    std::iter::once(heads).chain(table.rows.iter().map(row)).collect()
}

/// The characters of the headers of a row with all borders around them.
fn width_of_headers(headers: &[Header]) -> usize {
    widths(headers).iter().map(|width| width + 3).sum::<usize>() + 1
}

fn widths(rows: &[Header]) -> Vec<usize> {
    let columns = rows.first().map_or(0, Vec::len);
    let lines = |at: usize| rows.iter().filter_map(move |row| row.get(at)).flatten();
    let width = |at: usize| lines(at).map(|text| text.width()).max().unwrap_or(0);
    (0..columns).map(width).collect()
}

/// Replaces control characters, which a terminal would interpret.
fn clean(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() { '\u{fffd}' } else { letter }).collect()
}

fn cut(text: &str, room: usize) -> String {
    if text.width() <= room {
        return text.to_owned();
    }
    let mut short = String::new();
    for letter in text.chars() {
        if short.width() + 1 >= room {
            break;
        }
        short.push(letter);
    }
    format!("{short}…")
}

fn padded(text: &str, width: usize, right: bool) -> String {
    let space = " ".repeat(width.saturating_sub(text.width()));
    if right { format!("{space}{text}") } else { format!("{text}{space}") }
}

fn centred(text: &str, width: usize) -> String {
    let space = width.saturating_sub(text.width());
    format!("{}{text}{}", " ".repeat(space / 2), " ".repeat(space - space / 2))
}

/// Wraps text between words into lines of at most `width` columns; longer words are not broken.
fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let fits = lines.last().is_some_and(|line| line.is_empty() || line.width() + 1 + word.width() <= width);
        if !fits {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines
}
