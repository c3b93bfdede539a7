use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use atsplat_files::FolderLock;

use crate::definition::{Choice, TableDefinition};
use crate::emit::{TableFormat, orders_as_markdown};
use crate::file_list::Written;
use crate::file_names::unused;
use crate::page::{Film, LiveTrial, Page, PageStore, PlotSection};
use crate::plot::{Drawing, PlotFault, PlotFormat};
use crate::plot_data::{frontier_plots, optimisation_section, store_plots, table_plots};
use crate::table::{Mixing, Source, Table, chosen_protocol_tables, tables};
use crate::{ReportError, file_list, page};

/// Size of a page if none is requested, in megabytes of 10⁶ bytes.
pub const PAGE_MEGABYTES: u16 = 8;

/// What a report contains.
#[derive(Clone, Debug)]
pub struct Request {
    /// Title of the page.
    pub title: String,
    /// Names of tables; tables without measured rows are omitted.
    pub tables: Vec<String>,
    /// Whether every protocol gets a separate table too.
    pub protocols: bool,
    /// File formats of tables.
    pub formats: Vec<TableFormat>,
    /// Whether a table may mix protocols.
    pub mixing: Mixing,
    /// Which columns and rows tables show, and the method to which they give differences.
    pub choice: Choice,
    /// Limit on the bytes of the page.
    pub max_bytes: usize,
    /// Plots from sources other than stores.
    pub sections: Vec<PlotSection>,
    /// Trials of the page's live view.
    pub live: Vec<LiveTrial>,
}

/// A report, ready to be written.
#[derive(Debug)]
pub struct Report {
    /// Tables with measured rows, in order.
    pub tables: Vec<Table>,
    /// Names of the requested tables without measured rows.
    pub unmeasured: Vec<String>,
    /// Plots by name, with those of sections last.
    pub plots: Vec<(String, Drawing)>,
    films: Vec<Film>,
    html: String,
    formats: Vec<TableFormat>,
}

impl Report {
    /// Makes tables, plots and the page from stores.
    ///
    /// # Errors
    /// [`ReportError::UnknownTable`], [`ReportError::Method`], and the errors of tables, plots and pages.
    pub fn new(request: &Request, stores: &[PageStore<'_>]) -> Result<Self, ReportError> {
        let sources: Vec<Source<'_>> = stores.iter().map(|store| store.source).collect();
        request.choice.check(&sources)?;
        let (mut measured, mut unmeasured) = (Vec::new(), Vec::new());
        let mut plots = frontier_plots(&sources)?;
        let cost = cost_section(&mut plots);
        for name in &request.tables {
            let definition = TableDefinition::named(name)?.with_choice(&request.choice);
            for table in tables(&definition, &sources, request.mixing)? {
                if table.is_measured() {
                    plots.extend(table_plots(&definition, &table, &sources));
                    measured.push(table);
                } else {
                    unmeasured.push(table.name);
                }
            }
        }
        if request.protocols {
            measured.extend(chosen_protocol_tables(&sources, request.mixing, &request.choice)?);
        }
        for source in &sources {
            plots.extend(store_plots(source)?);
        }
        let mut sections: Vec<PlotSection> =
            cost.into_iter().chain(optimisation_section(&sources)?).chain(request.sections.iter().cloned()).collect();
        name_apart(plots.iter_mut().chain(sections.iter_mut().flat_map(|section| &mut section.plots)));
        let title = request.title.clone();
        let (live, max_bytes) = (request.live.as_slice(), request.max_bytes);
        let page = Page { title, tables: &measured, plots: &plots, sections: &sections, live, stores, max_bytes };
        let html = page.write()?;
        plots.extend(sections.into_iter().flat_map(|section| section.plots));
        let films = request.live.iter().filter_map(|trial| trial.film.clone()).collect();
        Ok(Self { films, tables: measured, unmeasured, plots, html, formats: request.formats.clone() })
    }

    /// What is wrong with the plots, each with its plot's name; empty for a good report.
    pub fn plot_faults(&self) -> Vec<(&str, PlotFault)> {
        self.plots
            .iter()
            .flat_map(|(name, plot)| plot.faults().into_iter().map(move |fault| (name.as_str(), fault)))
            .collect()
    }

    /// The characters that the font of PNG plots lacks, with a box in their place: each with the shortest text that has it.
    pub fn without_glyph(&self) -> BTreeMap<char, &str> {
        let mut found: BTreeMap<char, &str> = BTreeMap::new();
        for (text, absent) in self.plots.iter().flat_map(|(_, plot)| plot.texts_without_glyph()) {
            for letter in absent {
                let shortest = found.entry(letter).or_insert(text);
                if text.len() < shortest.len() {
                    *shortest = text;
                }
            }
        }
        found
    }

    /// Bytes of the page.
    pub const fn page_bytes(&self) -> usize {
        self.html.len()
    }

    /// As [`Self::replace`], in a folder that is locked meanwhile, and created if necessary; returns the paths of all files.
    ///
    /// # Errors
    /// [`ReportError::InUse`] if another process writes into the folder, and those of [`Self::replace`].
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, ReportError> {
        let files = self.files()?;
        let _lock = FolderLock::of(folder)?;
        file_list::write(folder, &files).map(|written| written.files)
    }

    /// Writes `tables/`, `orders.md`, `plots/`, `films/` and `index.html` into a locked folder, and a list of these files with their
    /// hashes. Then removes the files of the report that was there before, as its list names them: not
    /// those that were changed since, and no others.
    ///
    /// # Errors
    /// Before anything is written, the errors of tables, plots and films, [`ReportError::NotOfReport`] if one of the files is there
    /// already and no report wrote it, or it was changed since, and [`ReportError::Io`] for a broken list; then
    /// [`ReportError::Io`].
    pub fn replace(&self, lock: &FolderLock) -> Result<Written, ReportError> {
        file_list::write(lock.folder(), &self.files()?)
    }

    /// All files by their paths in the report's folder, in the order of writing: the page, with which readers begin, is the last.
    fn files(&self) -> Result<Vec<(String, Vec<u8>)>, ReportError> {
        let mut files = Vec::new();
        for table in &self.tables {
            for format in &self.formats {
                let path = format!("tables/{}.{}", table.name, format.extension());
                files.push((path, format.write(table)?.into_bytes()));
            }
        }
        files.extend(orders_as_markdown(&self.tables).map(|orders| ("orders.md".to_owned(), orders.into_bytes())));
        for (name, drawing) in &self.plots {
            for format in [PlotFormat::Svg, PlotFormat::Png] {
                files.push((format!("plots/{name}.{}", format.extension()), drawing.encode(format)?));
            }
        }
        for film in &self.films {
            files.push((format!("films/{}.png", film.name), film.animated_png()?));
        }
        files.push((page::FILE.to_owned(), self.html.clone().into_bytes()));
        Ok(files)
    }
}

/// Gives every plot a different name, by which its files and its place on the page are called: labels of stores may differ in
/// letters that names do not have, and sections may show other stores under the same protocols.
fn name_apart<'a>(plots: impl Iterator<Item = &'a mut (String, Drawing)>) {
    let mut taken: BTreeSet<String> = BTreeSet::new();
    for (name, _) in plots {
        *name = unused(name, |name| taken.contains(name));
        taken.insert(name.clone());
    }
}

/// What a report begins with: the first frontier, which is taken out of the plots.
fn cost_section(frontiers: &mut Vec<(String, Drawing)>) -> Option<PlotSection> {
    if frontiers.is_empty() {
        return None;
    }
    let hint = match frontiers.len() {
        1 => "What each method takes for its quality, in seconds and in Gaussians.",
        _ => {
            "What each method takes for its quality, in seconds and in Gaussians; other protocols are among the plots below."
        }
    };
    Some(PlotSection {
        title: "What accuracy costs".to_owned(),
        hint: hint.to_owned(),
        plots: vec![frontiers.remove(0)],
        before_tables: true,
        stores: Vec::new(),
    })
}

/// Labels of stores, all different: the folder's name, with a number if several have the same.
pub fn store_labels(stores: &[PathBuf]) -> Vec<String> {
    let names: Vec<String> = stores.iter().map(|path| atsplat_files::name_of(path)).collect();
    let mut labels: Vec<String> = Vec::new();
    for (at, name) in names.iter().enumerate() {
        let twins = names.iter().filter(|other| *other == name).count();
        let label = if twins > 1 { format!("{name} ({})", at + 1) } else { name.clone() };
        // A folder may have the name that another label got.
        let label = unused(&label, |label| labels.iter().any(|other| other == label));
        labels.push(label);
    }
    labels
}

#[cfg(test)]
mod tests {
    use atsplat_results::MethodRecord;

    use super::*;
    use crate::sample::{atsplat, nearest_view, preset, results};

    #[test]
    fn stores_of_the_same_name_get_distinct_labels() {
        let stores = ["a/run", "b/run", "c/other"].map(PathBuf::from);
        assert_eq!(store_labels(&stores), ["run (1)", "run (2)", "other"]);
        let stores = ["a/run", "b/run", "c/run (1)"].map(PathBuf::from);
        assert_eq!(store_labels(&stores), ["run (1)", "run (2)", "run (1)-2"]);
    }

    #[test]
    fn nothing_is_written_if_a_file_cannot_be_made() {
        let film = Film { name: "empty".to_owned(), columns: Vec::new(), note: String::new(), frames: Vec::new() };
        let report = Report {
            tables: Vec::new(),
            unmeasured: Vec::new(),
            plots: Vec::new(),
            films: vec![film],
            html: "page".to_owned(),
            formats: Vec::new(),
        };
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("page");
        assert!(matches!(report.write(&page), Err(ReportError::Image(_))), "a film without frames");
        assert!(!page.exists());
        assert_eq!(Report { films: Vec::new(), ..report }.write(&page).unwrap().len(), 2, "the page and the list");
    }

    fn request(sections: Vec<PlotSection>) -> Request {
        Request {
            title: String::new(),
            tables: Vec::new(),
            protocols: false,
            formats: Vec::new(),
            mixing: Mixing::Apart,
            choice: Choice::default(),
            max_bytes: 0,
            sections,
            live: Vec::new(),
        }
    }

    #[test]
    fn a_folder_that_another_process_writes_into_is_left_alone() {
        let report = Report {
            tables: Vec::new(),
            unmeasured: Vec::new(),
            plots: Vec::new(),
            films: Vec::new(),
            html: "page".to_owned(),
            formats: Vec::new(),
        };
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("page");
        let lock = FolderLock::of(&page).unwrap();
        assert!(matches!(report.write(&page), Err(ReportError::InUse { folder, .. }) if folder == page));
        assert!(!page.join("index.html").exists());
        let written = report.replace(&lock).unwrap();
        drop(lock);
        assert_eq!(report.write(&page).unwrap(), written.files);
        assert!(page.join("index.html").is_file());
    }

    #[test]
    fn titles_that_the_font_of_bitmaps_lacks_are_named() {
        let named = |title: &str| {
            let other = MethodRecord { title: title.to_owned(), ..nearest_view() };
            let results = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ()), other]);
            let store = PageStore { source: Source { label: "run", results: &results }, folder: None };
            let report = Report::new(&request(Vec::new()), &[store]).unwrap();
            report.without_glyph().into_iter().map(|(letter, text)| (letter, text.to_owned())).collect::<Vec<_>>()
        };
        assert_eq!(named("λ-net"), []);
        assert_eq!(named("模 A"), [('模', "模 A".to_owned())]);
    }

    /// Both labels are `a-b` in file names, and the section shows another frontier and another plot of a store under their names.
    #[test]
    fn every_plot_has_a_separate_file() {
        let results = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ()), nearest_view()]);
        let source = |label| Source { label, results: &results };
        let plots = frontier_plots(&[source("other")]).unwrap().into_iter().chain(store_plots(&source("a b")).unwrap());
        let section = PlotSection {
            title: "Others".to_owned(),
            hint: String::new(),
            plots: plots.collect(),
            before_tables: false,
            stores: Vec::new(),
        };
        let store = |label| PageStore { source: source(label), folder: None };
        let report = Report::new(&request(vec![section]), &[store("a b"), store("a-b")]).unwrap();
        let names: Vec<&str> = report.plots.iter().map(|(name, _)| name.as_str()).collect();
        for expected in ["a-b-re10k-2v-256-time-2", "a-b-re10k-2v-256-time-3", "frontier-re10k-2v-256-2"] {
            assert!(names.contains(&expected), "{names:?}");
        }
        assert_eq!(names.len(), names.iter().collect::<BTreeSet<_>>().len(), "{names:?}");
        for name in names {
            assert_eq!(report.html.matches(&format!("id=\"plot-{name}\"")).count(), 1, "{name}");
        }
    }
}
