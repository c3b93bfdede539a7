use std::path::{Path, PathBuf};

use crate::definition::TableDefinition;
use crate::emit::TableFormat;
use crate::figures::{of_store, of_table};
use crate::page::{Page, PageStore, PictureBudget, PlotSection};
use crate::plot::{Drawing, PlotFormat};
use crate::table::{Mixing, Source, Table, tables};
use crate::{ReportError, page};

/// What a report is made of.
#[derive(Clone, Debug)]
pub struct Request {
    /// Title of the page.
    pub title: String,
    /// Names of tables; those that nothing was measured for are left out.
    pub tables: Vec<String>,
    /// What tables are written as.
    pub formats: Vec<TableFormat>,
    /// Whether protocols may be mixed.
    pub mixing: Mixing,
    /// How many bytes of pictures the page may hold.
    pub budget: PictureBudget,
    /// Plots of more than stores hold.
    pub sections: Vec<PlotSection>,
}

/// A report, ready to be written.
#[derive(Debug)]
pub struct Report {
    /// Measured tables in order.
    pub tables: Vec<Table>,
    /// Tables that were asked for and that nothing was measured for.
    pub unmeasured: Vec<String>,
    /// Plots by name, those of sections last.
    pub plots: Vec<(String, Drawing)>,
    html: String,
    formats: Vec<TableFormat>,
}

impl Report {
    /// Makes tables, plots and the page of stores.
    ///
    /// # Errors
    /// [`ReportError::UnknownTable`], and what tables, plots and pages say.
    pub fn new(request: &Request, stores: &[PageStore<'_>]) -> Result<Self, ReportError> {
        let sources: Vec<Source<'_>> = stores.iter().map(|store| store.source).collect();
        let (mut measured, mut unmeasured, mut plots) = (Vec::new(), Vec::new(), Vec::new());
        for name in &request.tables {
            let definition = TableDefinition::named(name)?;
            for table in tables(&definition, &sources, request.mixing)? {
                if table.is_measured() {
                    plots.extend(of_table(&definition, &table, &sources));
                    measured.push(table);
                } else {
                    unmeasured.push(table.name);
                }
            }
        }
        for source in &sources {
            plots.extend(of_store(source)?);
        }
        let (title, sections) = (request.title.clone(), request.sections.as_slice());
        let page = Page { title, tables: &measured, plots: &plots, sections, stores, budget: request.budget };
        let html = page.write()?;
        plots.extend(sections.iter().flat_map(|section| section.plots.iter().cloned()));
        Ok(Self { tables: measured, unmeasured, plots, html, formats: request.formats.clone() })
    }

    /// Writes `tables/`, `plots/` and `index.html` into a folder, which is made where needed; tells every file.
    ///
    /// # Errors
    /// [`ReportError::File`], and what tables and plots say.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, ReportError> {
        let mut files = Vec::new();
        for table in &self.tables {
            for format in &self.formats {
                let path = folder.join("tables").join(format!("{}.{}", table.name, format.extension()));
                files.push(put(path, format.write(table)?.as_bytes())?);
            }
        }
        for (name, drawing) in &self.plots {
            for format in [PlotFormat::Svg, PlotFormat::Png] {
                let path = folder.join("plots").join(format!("{name}.{}", format.extension()));
                files.push(put(path, &drawing.encode(format)?)?);
            }
        }
        files.push(put(folder.join(page::FILE), self.html.as_bytes())?);
        Ok(files)
    }
}

fn put(path: PathBuf, bytes: &[u8]) -> Result<PathBuf, ReportError> {
    let folder = path.parent().unwrap_or(&path).to_owned();
    std::fs::create_dir_all(&folder).map_err(|source| ReportError::File {
        doing: "making a folder",
        source,
        path: folder,
    })?;
    match atsplat_files::write_unsynced(&path, bytes) {
        Ok(()) => Ok(path),
        Err(source) => Err(ReportError::File { doing: "writing", source, path }),
    }
}
