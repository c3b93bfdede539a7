//! The command of a method: its words, and the files that they name.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::{iter, mem};

use atsplat_files::Sha256Digest;

use crate::EvalError;

/// What separates commands in the text for a shell, or stands around their words.
const OPERATORS: [char; 6] = [';', '&', '|', '(', ')', '<'];

/// Program and arguments.
pub(super) fn words(command: &str) -> Result<Vec<String>, EvalError> {
    let words = shlex::split(command).filter(|words| !words.is_empty());
    words.ok_or_else(|| EvalError::Settings {
        what: "method exec",
        expected: "a program and its arguments, quoted as for a shell".to_owned(),
        found: format!("{command:?}"),
    })
}

/// The files that a command names, each with its SHA-256: results of a changed script are not mixed with those of the old one.
///
/// A name is a word, what follows an `=` in it (`--checkpoint=FILE`), or either of them in a command that is a word itself,
/// as `sh -c` takes it.
pub(super) fn files(words: &[String]) -> Result<BTreeMap<String, String>, EvalError> {
    hashed(words.iter().flat_map(|word| named(word)).collect::<BTreeSet<_>>())
}

/// The files of these names, each with its SHA-256.
pub(super) fn hashed(names: impl IntoIterator<Item = String>) -> Result<BTreeMap<String, String>, EvalError> {
    let hash = |name: String| {
        let path = Path::new(&name);
        let sha256 =
            Sha256Digest::of_file(path).map_err(EvalError::io("reading a file of a method's command", path))?;
        Ok((name, sha256.to_string()))
    };
    names.into_iter().map(hash).collect()
}

/// The files that a word names.
fn named(word: &str) -> Vec<String> {
    if is_file(word) {
        return vec![word.to_owned()];
    }
    let mut found: Vec<String> = with_values(word).collect();
    let mut is_output = false;
    for word in shlex::split(word).unwrap_or_default() {
        // A shell writes to what follows a `>`: a log, no part of the program.
        if mem::replace(&mut is_output, word.ends_with('>')) {
            continue;
        }
        if is_file(&word) {
            found.push(word);
            continue;
        }
        let parts = word.split(OPERATORS).filter_map(|part| part.split('>').next());
        found.extend(parts.flat_map(with_values));
    }
    found
}

/// Those of a text, and of what follows each `=` in it, that are files.
fn with_values(text: &str) -> impl Iterator<Item = String> {
    let values = text.match_indices('=').filter_map(|(at, _)| text.get(at + 1..));
    iter::once(text).chain(values).filter(|text| is_file(text)).map(str::to_owned)
}

fn is_file(name: &str) -> bool {
    Path::new(name).is_file()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn files_are_found_as_words_behind_equals_signs_and_in_the_text_for_a_shell() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str| {
            let path = folder.path().join(name);
            fs::write(&path, name).unwrap();
            path.display().to_string()
        };
        let [program, weights, log, spaced] = ["m.py", "epoch=3.bin", "log", "my m.py"].map(write);
        let files_of = |command: &str| files(&words(command).unwrap()).unwrap();
        let of = |command: &str| files_of(command).into_keys().collect::<Vec<_>>();
        for command in [
            format!("python {program} --checkpoint {weights}"),
            format!("python {program} --checkpoint={weights}"),
            format!("python {program} --override=model.checkpoint={weights}"),
            format!("sh -c \"CUDA_VISIBLE_DEVICES=$ATSPLAT_PROCESS exec python {program} {weights}\""),
            format!("sh -c \"WEIGHTS={weights} exec python '{program}' 2>> {log}\""),
            format!("sh -c '(python {program} --checkpoint={weights})2>{log}; wait'"),
            format!("env --split-string='python {program}' {weights}"),
        ] {
            assert_eq!(of(&command), [weights.clone(), program.clone()], "{command}");
        }
        assert_eq!(of(&format!("sh '{spaced}'")), [spaced]);
        assert!(of("sh -c \"it's\"").is_empty());
        assert_eq!(files_of(&format!("sh -c 'python {program}'"))[&program], Sha256Digest::of(b"m.py").to_string());
        let missing = hashed([folder.path().join("no.py").display().to_string()]).unwrap_err().to_string();
        assert!(missing.contains("no.py"), "{missing}");
    }
}
