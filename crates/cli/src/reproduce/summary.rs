//! The report of a run, and its printed summary.

use std::fmt::Write as _;
use std::path::Path;

use atsplat_eval::discovery::NotRun;
use atsplat_files::FolderLock;
use atsplat_numeric::counted;
use atsplat_report::definition::{Choice, TableDefinition};
use atsplat_report::emit::TableFormat;
use atsplat_report::page::{LiveTrial, PageStore, PlotSection};
use atsplat_report::table::{Mixing, Source, agreement};
use atsplat_report::{Report, Request, Written};
use atsplat_results::Results;
use indexmap::IndexSet;

use crate::print::print_text;
use crate::report::{PageArgs, TITLE, report_other_files};

/// Writes tables, plots and a page for all stores, which are in the locked folder.
pub(super) fn write(
    lock: &FolderLock,
    stores: &[(String, Results)],
    sections: Vec<PlotSection>,
    live: Vec<LiveTrial>,
    page: PageArgs,
) -> anyhow::Result<Report> {
    let folder = lock.folder();
    let folders: Vec<_> = stores.iter().map(|(name, _)| folder.join(name)).collect();
    let pages: Vec<PageStore<'_>> = stores
        .iter()
        .zip(&folders)
        .map(|((label, results), folder)| PageStore { source: Source { label, results }, folder: Some(folder) })
        .collect();
    let request = Request {
        title: TITLE.to_owned(),
        tables: TableDefinition::names().map(str::to_owned).collect(),
        protocols: true,
        formats: vec![
            TableFormat::Terminal,
            TableFormat::Markdown,
            TableFormat::Latex,
            TableFormat::Csv,
            TableFormat::Json,
        ],
        mixing: Mixing::Apart,
        choice: Choice::default(),
        max_bytes: page.max_bytes(),
        sections,
        live,
    };
    let report = Report::new(&request, &pages)?;
    let Written { removed, others, .. } = report.replace(lock)?;
    page.warn_of_size(&report);
    report_other_files(folder, &removed, &others);
    Ok(report)
}

/// Prints every table's agreement with the paper, and what could not be run.
pub(super) fn print(
    report: &Report,
    stores: &[(String, Results)],
    not_run: &[NotRun],
    trained: &str,
    folder: &Path,
) -> anyhow::Result<()> {
    let (trials, targets) = stores.iter().fold((0, 0), |(trials, targets), (_, results)| {
        (trials + results.trials.len(), targets + results.targets.len())
    });
    let [trials, targets] = [(trials, "trial"), (targets, "target")].map(|(count, what)| counted(count as u64, what));
    let mut text = format!("{trials}, {targets}; ATSplat: {trained}\n\n");
    for table in report.tables.iter().filter(|table| table.is_published()) {
        let agreement = agreement(table);
        writeln!(text, "{}", table.title)?;
        if let Some(headline) = &agreement.headline {
            writeln!(text, "    {headline}")?;
        }
        writeln!(text, "    {agreement}")?;
    }
    if !report.unmeasured.is_empty() {
        writeln!(text, "\nno results for: {}", report.unmeasured.join(", "))?;
    }
    let metrics = stores.iter().flat_map(|(_, results)| &results.provenance.metrics);
    let absent: IndexSet<String> =
        metrics.filter_map(|metric| Some(format!("{}: {}", metric.id, metric.absent.as_ref()?))).collect();
    for line in absent {
        writeln!(text, "{line}")?;
    }
    for (plot, fault) in report.plot_faults() {
        writeln!(text, "plot {plot}: {fault}")?;
    }
    for NotRun { what, why } in not_run {
        writeln!(text, "not run: {what}: {why}")?;
    }
    writeln!(text, "\n{}", folder.join("index.html").display())?;
    print_text(&text)
}
