//! How `transforms.json` scenes are detected and opened.

use super::NerfstudioScenes;
use super::source::scene_files;
use crate::format::{Format, FormatReader};
use crate::json;

pub(crate) const READER: FormatReader = FormatReader {
    format: Format::Nerfstudio,
    path_of_file: |path, start| json::starts_with_bracket(start, b'{').then(|| path.to_owned()),
    is_folder_of_format: |path| Ok(!scene_files(path, false)?.is_empty()),
    read_to_open: |_| Ok(Vec::new()),
    open: |path, options, warnings| {
        let source = NerfstudioScenes::open(path, options.nerfstudio, warnings)?;
        let collections = source.collections().clone();
        Ok((Box::new(source), collections))
    },
};
