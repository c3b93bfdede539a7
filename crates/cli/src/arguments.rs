//! Reads the command line, and rejects URLs and paths that no command could use, before any command starts.

use std::ffi::{OsStr, OsString};
use std::io::{ErrorKind, Write as _, stdout};
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue};
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Command, CommandFactory as _, FromArgMatches as _};

use crate::Cli;
use crate::exit::Exit;
use crate::parse::usage_error;
use crate::print::print_status;

/// Arguments that are text or commands, which may look like URLs; every other one is a path, a name or a number.
const TEXTS: [&str; 8] = ["title", "why", "note", "name", "key", "route_key", "only", "methods"];

/// Arguments whose paths are kept in records, which are JSON, by command.
const RECORDED: [(&str, &[&str]); 3] =
    [("render", &["scene", "cameras"]), ("fit", &["data"]), ("reconstruct", &["data", "backbone", "renders", "plots"])];

/// Arguments whose paths `--json` prints, by command.
const PRINTED: [(&str, &[&str]); 11] = [
    ("render", &["out"]),
    ("report", &["out"]),
    ("run", &["out"]),
    ("score", &["out"]),
    ("merge", &["out"]),
    ("data simulate", &["out"]),
    ("drift accept", &["baseline"]),
    ("weights import", &["file", "backbone", "out"]),
    ("weights export", &["file", "out"]),
    ("weights inspect", &["file"]),
    ("weights verify", &["file"]),
];

/// Where copies of objects are kept: commands with this argument read URLs.
const CACHE: &str = "cache";

/// Options that `--device` replaced; by itself, the parser suggests the name that is most similar, `--background`.
const FORMER_DEVICES: [&str; 2] = ["--backend", "--adapter"];

/// The command line as a command with its arguments.
pub(crate) fn parse(arguments: impl IntoIterator<Item = OsString>) -> Result<Cli, clap::Error> {
    let mut command = with_negative_numbers(Cli::command());
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let matches = command.try_get_matches_from_mut(&arguments);
    let matches = matches.map_err(|error| suggest_device(error, named(&command, &arguments)))?;
    check(&command, &matches, "")?;
    Cli::from_arg_matches(&matches).map_err(|error| error.format(&mut command))
}

/// The command whose options take negative numbers: what is wrong with one is said by the option, not by the parser, which takes it
/// for an option itself.
fn with_negative_numbers(command: Command) -> Command {
    let takes = |arg: &Arg| arg.get_long().is_some() && arg.get_action().takes_values();
    let command = command.mut_args(|arg| if takes(&arg) { arg.allow_negative_numbers(true) } else { arg });
    command.mut_subcommands(with_negative_numbers)
}

/// The innermost command that the arguments name.
fn named<'a>(command: &'a Command, arguments: &[OsString]) -> &'a Command {
    arguments.iter().fold(command, |command, word| command.find_subcommand(word).unwrap_or(command))
}

/// Suggests `--device`, if the command has it, instead of the options that it replaced.
fn suggest_device(mut error: clap::Error, command: &Command) -> clap::Error {
    let has_device = command.get_arguments().any(|arg| arg.get_long() == Some("device"));
    let unknown = error.get(ContextKind::InvalidArg).filter(|_| has_device);
    if unknown.is_some_and(|unknown| FORMER_DEVICES.contains(&unknown.to_string().as_str())) {
        error.insert(ContextKind::SuggestedArg, ContextValue::String("--device".to_owned()));
    }
    error
}

/// Prints an error of [`parse`], or the help or version that was asked for, and returns the exit code.
pub(crate) fn print(error: &clap::Error) -> ExitCode {
    let printed = error.print().and_then(|()| stdout().flush());
    if error.use_stderr() {
        return Exit::UsageError.into();
    }
    match printed {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            print_status(&format!("error: writing to standard output: {error}"));
            ExitCode::FAILURE
        }
        _ => ExitCode::SUCCESS,
    }
}

/// Checks the arguments of a command and of the one below it; `path` names those above it.
fn check(command: &Command, matches: &ArgMatches, path: &str) -> Result<(), clap::Error> {
    for arg in command.get_arguments() {
        let id = arg.get_id().as_str();
        let values = matches.try_get_raw(id).ok().flatten().filter(|_| is_given(matches, id));
        for value in values.into_iter().flatten() {
            check_url(command, arg, value).map_err(usage_error)?;
            let prints_json = || matches.try_get_one::<bool>("json").is_ok_and(|json| json == Some(&true));
            if value.to_str().is_none() && (lists(&RECORDED, path, id) || lists(&PRINTED, path, id) && prints_json()) {
                let (name, value) = (name_of(arg), value.to_string_lossy());
                return Err(usage_error(format!("{name}: {value}: expected a path in UTF-8, as JSON requires")));
            }
        }
    }
    check_cache(command, matches).map_err(usage_error)?;
    let Some((name, below)) = matches.subcommand() else { return Ok(()) };
    let path = format!("{path} {name}");
    command.find_subcommand(name).map_or(Ok(()), |command| check(command, below, path.trim_start()))
}

fn is_given(matches: &ArgMatches, id: &str) -> bool {
    matches.try_contains_id(id).is_ok_and(|found| found) && matches.value_source(id) == Some(ValueSource::CommandLine)
}

/// Rejects a folder for copies of objects where nothing is copied: a URL may be misspelt.
fn check_cache(command: &Command, matches: &ArgMatches) -> Result<(), String> {
    let ids = command.get_arguments().map(|arg| arg.get_id().as_str()).filter(|id| takes_url(command, id));
    let mut values = ids.filter_map(|id| matches.try_get_raw(id).ok().flatten()).flatten();
    if !is_given(matches, CACHE) || values.any(|value| scheme(&value.to_string_lossy()).is_some()) {
        return Ok(());
    }
    Err("--cache: expected a URL such as s3://bucket/data among the paths, found none: nothing is copied".to_owned())
}

fn lists(arguments: &[(&str, &[&str])], command: &str, id: &str) -> bool {
    arguments.iter().any(|(name, ids)| *name == command && ids.contains(&id))
}

/// Rejects a URL where only a path is allowed (it would be a local folder named `s3:`), and a URL of unknown storage.
fn check_url(command: &Command, arg: &Arg, value: &OsStr) -> Result<(), String> {
    let text = value.to_string_lossy();
    let Some(scheme) = scheme(&text).filter(|_| !TEXTS.contains(&arg.get_id().as_str())) else { return Ok(()) };
    let name = name_of(arg);
    if !takes_url(command, arg.get_id().as_str()) {
        return Err(format!("{name}: expected a path of this machine, found {text}"));
    }
    if atsplat_objects::SCHEMES.contains(&scheme) {
        return Ok(());
    }
    let known = atsplat_objects::SCHEMES.map(|scheme| format!("{scheme}://")).join(", ");
    Err(format!("{name}: expected a path of this machine, or a URL that begins with one of {known}, found {text}"))
}

/// Whether an argument may be a URL of object storage.
fn takes_url(command: &Command, id: &str) -> bool {
    match id {
        "out" => ["run", "score", "merge"].contains(&command.get_name()),
        "data" | "store" | "stores" | "repeat" => command.get_arguments().any(|arg| arg.get_id() == CACHE),
        _ => false,
    }
}

/// The scheme of a URL; `None` for other text. One letter is a drive.
fn scheme(text: &str) -> Option<&str> {
    let (scheme, _) = text.split_once("://")?;
    let is_part = |byte: u8| byte.is_ascii_alphanumeric() || b"+-._".contains(&byte);
    let is_scheme = scheme.len() > 1 && scheme.starts_with(|first: char| first.is_ascii_alphabetic());
    (is_scheme && scheme.bytes().all(is_part)).then_some(scheme)
}

/// `--out`, or `<DATA>` for an argument without a name.
fn name_of(arg: &Arg) -> String {
    let value = || arg.get_value_names().and_then(|names| names.first()).map_or("argument", |name| name.as_str());
    arg.get_long().map_or_else(|| format!("<{}>", value()), |long| format!("--{long}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error_of(text: &str) -> Option<String> {
        let words = text.split(' ').map(OsString::from);
        parse(words).err().map(|error| error.to_string())
    }

    fn ids(command: &Command, path: &str, all: &mut Vec<(String, String)>) {
        for arg in command.get_arguments() {
            all.push((path.to_owned(), arg.get_id().to_string()));
        }
        for below in command.get_subcommands() {
            ids(below, format!("{path} {}", below.get_name()).trim_start(), all);
        }
    }

    #[test]
    fn lists_name_arguments_that_exist() {
        let mut command = Cli::command();
        command.build();
        let mut all = Vec::new();
        ids(&command, "", &mut all);
        for text in TEXTS {
            assert!(all.iter().any(|(_, id)| id == text), "{text}");
        }
        for (path, listed) in RECORDED.iter().chain(&PRINTED) {
            for id in *listed {
                assert!(all.contains(&((*path).to_owned(), (*id).to_owned())), "{path}: {id}");
            }
        }
    }

    #[test]
    fn urls_are_errors_where_a_path_is_expected() {
        let path = "expected a path of this machine, found ";
        for (text, expected) in [
            ("atsplat render a.ply --orbit --out s3://b/out", format!("--out: {path}s3://b/out")),
            ("atsplat render a.ply --orbit --out o --preview S3://b/o.png", format!("--preview: {path}S3://b/o.png")),
            ("atsplat render gs://b/a.ply --orbit --out o", format!("<SCENE>: {path}gs://b/a.ply")),
            ("atsplat data simulate s3://b/rooms", format!("<OUT>: {path}s3://b/rooms")),
            ("atsplat data export d s3://b/o.csv", format!("<OUT>: {path}s3://b/o.csv")),
            ("atsplat data export d az://b/o --chunks", format!("<OUT>: {path}az://b/o")),
            ("atsplat data motion s3://b/d", format!("<PATH>: {path}s3://b/d")),
            ("atsplat reproduce --data s3://b/d", format!("--data: {path}s3://b/d")),
            ("atsplat report s --out s3://b/page", format!("--out: {path}s3://b/page")),
            ("atsplat drift accept s --why w --baseline s3://b/x", format!("--baseline: {path}s3://b/x")),
            (
                "atsplat fit d --views .. --steps 1 --strategy 3dgs --out s3://b/o.ply",
                format!("--out: {path}s3://b/o.ply"),
            ),
            (
                "atsplat reconstruct d --views .. --weights micro-rooms --out o.ply --renders hf://b/r",
                format!("--renders: {path}hf://b/r"),
            ),
            (
                "atsplat run re10k-2v-256 --data d --method warp --out s --index s3://b/i",
                format!("--index: {path}s3://b/i"),
            ),
            ("atsplat man --out s3://b/man", format!("--out: {path}s3://b/man")),
        ] {
            let error = error_of(text).unwrap_or_default();
            assert!(error.contains(&expected), "{text}: {error}");
        }
        let run = "atsplat run re10k-2v-256 --data d --method warp --out";
        for text in [
            format!("{run} gcs://b/o"),
            format!("{run} S3://b/o"),
            "atsplat score re10k-2v-256 --data d --ply p --out hf://b/o".to_owned(),
            "atsplat merge a s3a://b/x --out o".to_owned(),
            "atsplat report HTTPS://b/x".to_owned(),
            "atsplat data inspect hf://b/x".to_owned(),
        ] {
            let error = error_of(&text).unwrap_or_default();
            assert!(error.contains("begins with one of s3://, gs://, az://, file://, found "), "{text}: {error}");
        }
        for text in [
            format!("{run} s3://b/o"),
            "atsplat merge s3://b/1 gs://b/2 --out az://c/o".to_owned(),
            "atsplat data inspect file:///tmp/a".to_owned(),
            "atsplat drift accept s3://b/s --repeat s3://b/t --baseline b --why https://example.org/1".to_owned(),
            "atsplat tradeoff s3://b/s".to_owned(),
            "atsplat report s --title https://example.org".to_owned(),
            "atsplat fit s3://b/d --views .. --steps 1 --strategy 3dgs --out ./s3:/o.ply".to_owned(),
            "atsplat run re10k-2v-256 --data c://d --method exec:a://b --out o".to_owned(),
        ] {
            assert_eq!(error_of(&text), None, "{text}");
        }
    }

    #[test]
    fn a_cache_without_a_url_is_an_error() {
        let run = "atsplat run re10k-2v-256 --method warp --cache c";
        for text in [
            "atsplat data inspect d --cache c",
            "atsplat data inspect s3:/b/d --cache c",
            &format!("{run} --data d --out o"),
            "atsplat report a b --cache c",
            "atsplat tradeoff sweep rooms-2v-128 --data d --weights w --sweep s --out o --cache c",
        ] {
            let error = error_of(text).unwrap_or_default();
            assert!(error.contains("--cache: expected a URL such as s3://bucket/data"), "{text}: {error}");
        }
        for text in [
            "atsplat data inspect s3://b/d --cache c",
            &format!("{run} --data d --out s3://b/o"),
            &format!("{run} --data gs://b/d --out o"),
            "atsplat merge a s3://b/x --out o --cache c",
            "atsplat drift accept a --repeat s3://b/t --baseline b --why w --cache c",
        ] {
            assert_eq!(error_of(text), None, "{text}");
        }
    }

    /// None of these numbers is allowed.
    #[test]
    fn a_negative_number_is_the_value_of_its_option() {
        let render = "atsplat render a.ply --out o";
        for (text, option) in [
            (format!("{render} --orbit --near -1"), "--near"),
            (format!("{render} --orbit --distance -0.5"), "--distance"),
            (format!("{render} --orbit --tolerance -0.5"), "--tolerance"),
            (format!("{render} --orbit -1"), "--orbit"),
            (format!("{render} --orbit --exposure -1"), "--exposure"),
            ("atsplat data simulate rooms --scenes -1".to_owned(), "--scenes"),
            ("atsplat --threads -1 adapters".to_owned(), "--threads"),
            ("atsplat fit d --views .. --steps 1 --strategy 3dgs --out o.ply --extent -2".to_owned(), "--extent"),
        ] {
            let error = error_of(&text).unwrap_or_default();
            let is_its_value = error.contains("invalid value '-") && error.contains(&format!("for '{option} "));
            assert!(is_its_value, "{text}: {error}");
        }
        assert_eq!(error_of(&format!("{render} --orbit --azimuth -30 --elevation -5 --sweep -90.5")), None);
        let error = error_of(&format!("{render} --orbit --json -1")).unwrap_or_default();
        assert!(error.contains("unexpected argument '-1'"), "{error}");
    }

    #[test]
    fn options_that_were_replaced_lead_to_their_successor() {
        for (text, option) in [
            ("atsplat run rooms-2v-128 --data d --method 3dgs:2 --out o --backend gpu", "--backend"),
            ("atsplat score rooms-2v-128 --data d --ply p --out o --backend=reference", "--backend"),
            ("atsplat render a.ply --orbit --out o --backend gpu", "--backend"),
            ("atsplat render a.ply --orbit --out o --adapter 0", "--adapter"),
        ] {
            let error = error_of(text).unwrap_or_default();
            assert!(error.contains(&format!("unexpected argument '{option}' found")), "{text}: {error}");
            assert!(error.contains("argument exists: '--device'"), "{text}: {error}");
        }
        for text in
            ["atsplat report s --out p --backend gpu", "atsplat drift accept s --why w --baseline b --adapter 0"]
        {
            let error = error_of(text).unwrap_or_default();
            assert!(error.contains("unexpected argument '--") && !error.contains("--device"), "{text}: {error}");
        }
        let error = error_of("atsplat render a.ply --orbit --out o --backgrund white").unwrap_or_default();
        assert!(error.contains("argument exists: '--background'"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn paths_that_json_cannot_contain_are_errors() {
        use std::os::unix::ffi::OsStringExt as _;
        let error_of = |text: &str| {
            let latin_1 = |byte: u8| if byte == b'?' { 0xe9 } else { byte };
            let words = text.split(' ').map(|word| OsString::from_vec(word.bytes().map(latin_1).collect()));
            parse(words).err().map(|error| error.to_string())
        };
        for (text, name) in [
            ("atsplat render caf?.ply --orbit --out o", "<SCENE>: caf\u{fffd}.ply: expected a path in UTF-8"),
            ("atsplat render a.ply --cameras caf? --out o", "--cameras: caf\u{fffd}"),
            ("atsplat render a.ply --orbit --out caf? --json", "--out: caf\u{fffd}"),
            ("atsplat fit caf? --views .. --steps 1 --strategy 3dgs --out o.ply", "<DATA>: caf\u{fffd}"),
            ("atsplat reconstruct d --views .. --weights micro-rooms --out o.ply --plots caf?", "--plots: caf\u{fffd}"),
            ("atsplat merge a --out caf? --json", "--out: caf\u{fffd}"),
        ] {
            let error = error_of(text).unwrap_or_default();
            assert!(error.contains(name), "{text}: {error}");
        }
        for text in [
            "atsplat render a.ply --orbit --out caf?",
            "atsplat data inspect caf? --json",
            "atsplat merge a --out caf?",
        ] {
            assert_eq!(error_of(text), None, "{text}");
        }
    }
}
