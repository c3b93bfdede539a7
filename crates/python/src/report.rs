//! Tables and pages of stores.

use std::path::PathBuf;

use atsplat_report::definition::{Choice, TableDefinition};
use atsplat_report::emit::TableFormat;
use atsplat_report::page::{PageStore, table_html};
use atsplat_report::table::{Mixing, Source, Table, protocol_tables, tables as tables_of};
use atsplat_report::{PAGE_MEGABYTES, Report, Request, store_labels};
use atsplat_results::Results;
use pyo3::prelude::*;

use crate::error::Failure;
use crate::threads::work_with_stores;

/// Name, title and the texts of a table: JSON, terminal, Markdown, LaTeX, CSV and HTML.
type Texts = (String, String, [String; 6]);

/// The measured tables of stores: those that papers published, then one for each protocol.
#[pyfunction]
pub(crate) fn tables(py: Python<'_>, stores: Vec<PathBuf>, force: bool) -> Result<Vec<Texts>, Failure> {
    work_with_stores(py, || {
        let (results, labels) = (read(&stores)?, store_labels(&stores));
        let sources: Vec<Source<'_>> = sources(&results, &labels).collect();
        let mixing = mixing(force);
        let mut found: Vec<Table> = Vec::new();
        for name in TableDefinition::names() {
            let all = tables_of(&TableDefinition::named(name)?, &sources, mixing)?;
            found.extend(all.into_iter().filter(Table::is_measured));
        }
        found.extend(protocol_tables(&sources, mixing)?);
        found.iter().map(texts).collect()
    })
}

/// Writes tables, plots and the page; returns the paths of all files.
#[pyfunction]
pub(crate) fn write_report(
    py: Python<'_>,
    stores: Vec<PathBuf>,
    out: PathBuf,
    title: String,
    force: bool,
) -> Result<Vec<PathBuf>, Failure> {
    work_with_stores(py, || {
        let (results, labels) = (read(&stores)?, store_labels(&stores));
        let folders = stores.iter().map(|folder| Some(folder.as_path()));
        let stores: Vec<PageStore<'_>> =
            sources(&results, &labels).zip(folders).map(|(source, folder)| PageStore { source, folder }).collect();
        let request = Request {
            title,
            tables: TableDefinition::names().map(str::to_owned).collect(),
            protocols: true,
            formats: TableFormat::ALL.to_vec(),
            mixing: mixing(force),
            choice: Choice::default(),
            max_bytes: usize::from(PAGE_MEGABYTES) * 1_000_000,
            sections: Vec::new(),
            live: Vec::new(),
        };
        Ok(Report::new(&request, &stores)?.write(&out)?)
    })
}

const fn mixing(force: bool) -> Mixing {
    if force { Mixing::Forced } else { Mixing::Apart }
}

fn read(stores: &[PathBuf]) -> Result<Vec<Results>, Failure> {
    Results::read_each(stores).into_iter().map(|results| Ok(results?)).collect()
}

fn sources<'a>(results: &'a [Results], labels: &'a [String]) -> impl Iterator<Item = Source<'a>> {
    results.iter().zip(labels).map(|(results, label)| Source { label, results })
}

fn texts(table: &Table) -> Result<Texts, Failure> {
    let [json, terminal, markdown, latex, csv] =
        [TableFormat::Json, TableFormat::Terminal, TableFormat::Markdown, TableFormat::Latex, TableFormat::Csv]
            .map(|format| format.write(table));
    Ok((table.name.clone(), table.title.clone(), [json?, terminal?, markdown?, latex?, csv?, table_html(table)]))
}
