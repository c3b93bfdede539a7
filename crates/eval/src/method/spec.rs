//! Methods as text: `mcmc:10s`, `MVSplat=renders:DIR`.

use std::path::PathBuf;
use std::str::FromStr;

use atsplat_files::InvalidText;
use atsplat_fit::{Budget, Strategy};
use atsplat_results::store::images::{CONTEXT, TRUTH};
use thiserror::Error;

/// A method that is not loaded yet: `KIND` or `NAME=KIND`.
#[derive(Clone, Debug, PartialEq)]
pub struct MethodSpec {
    /// Name in the results; by default that of the method.
    pub name: Option<String>,
    /// What it is.
    pub kind: MethodKind,
}

/// What a method is.
#[derive(Clone, Debug, PartialEq)]
pub enum MethodKind {
    /// `atsplat`: a network.
    AtSplat,
    /// `atsplat+refine:BUDGET`: the network's Gaussians, optimised further.
    Refined(Budget),
    /// `3dgs:BUDGET`, `mip-splatting:BUDGET` or `mcmc:BUDGET`: Gaussians optimised from a random start.
    Optimised(Strategy, Budget),
    /// `nearest-view`.
    NearestView,
    /// `warp`.
    Warp,
    /// `renders:DIR`: images of any other method.
    Renders(PathBuf),
    /// `ply:DIR`: Gaussians of any other method.
    Ply(PathBuf),
    /// `exec:COMMAND`: a process with this command.
    Exec(String),
}

/// Text that is not a method.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum InvalidMethod {
    /// An unknown method, a name that results cannot have, or an invalid budget.
    #[error(transparent)]
    Text(#[from] InvalidText),
    /// A name was given to a baseline.
    #[error("{method} has no variants and takes no name, found {found:?}")]
    Named { method: String, found: String },
}

impl MethodKind {
    /// Whether it has a network.
    pub const fn has_network(&self) -> bool {
        matches!(self, Self::AtSplat | Self::Refined(_))
    }

    /// Whether it has a network or Gaussians to render.
    pub const fn uses_device(&self) -> bool {
        !matches!(self, Self::NearestView | Self::Warp | Self::Renders(_))
    }

    /// The names in arguments, which are those of the kinds of records too ([`atsplat_results::RecordKind`]).
    pub fn names() -> impl Iterator<Item = &'static str> {
        FORMS.iter().map(|(name, _)| *name)
    }

    fn parse(text: &str) -> Result<Option<Self>, InvalidText> {
        let (name, rest) = text.split_once(':').map_or((text, None), |(name, rest)| (name, Some(rest)));
        let form = FORMS.iter().find(|(known, _)| *known == name).map(|(_, form)| form);
        Ok(match (form, rest) {
            (Some(Form::Name(kind)), None) => Some(kind()),
            (Some(Form::Folder(kind)), Some(path)) if !path.is_empty() => Some(kind(PathBuf::from(path))),
            (Some(Form::Budget(kind)), Some(budget)) => Some(kind(budget.parse()?)),
            (Some(Form::Command(kind)), Some(text)) if !text.trim().is_empty() => Some(kind(text.to_owned())),
            _ => None,
        })
    }
}

/// What an argument has after a method's name and a colon.
enum Form {
    /// Nothing, nor a colon.
    Name(fn() -> MethodKind),
    Folder(fn(PathBuf) -> MethodKind),
    Budget(fn(Budget) -> MethodKind),
    Command(fn(String) -> MethodKind),
}

static FORMS: [(&str, Form); 10] = [
    ("atsplat", Form::Name(|| MethodKind::AtSplat)),
    ("atsplat+refine", Form::Budget(MethodKind::Refined)),
    ("3dgs", Form::Budget(|budget| MethodKind::Optimised(Strategy::Gaussians3d, budget))),
    ("mip-splatting", Form::Budget(|budget| MethodKind::Optimised(Strategy::MipSplatting, budget))),
    ("mcmc", Form::Budget(|budget| MethodKind::Optimised(Strategy::Mcmc, budget))),
    ("nearest-view", Form::Name(|| MethodKind::NearestView)),
    ("warp", Form::Name(|| MethodKind::Warp)),
    ("renders", Form::Folder(MethodKind::Renders)),
    ("ply", Form::Folder(MethodKind::Ply)),
    ("exec", Form::Command(MethodKind::Exec)),
];

impl MethodSpec {
    /// Methods separated by commas. A command is the last one: it may contain commas itself.
    ///
    /// # Errors
    /// [`InvalidMethod`] for the first one that is invalid.
    pub fn list(text: &str) -> Result<Vec<Self>, InvalidMethod> {
        let (mut methods, mut rest) = (Vec::new(), Some(text));
        while let Some(text) = rest {
            let is_command = parts(text).1.starts_with("exec:");
            let (first, others) =
                text.split_once(',').filter(|_| !is_command).map_or((text, None), |(a, b)| (a, Some(b)));
            methods.push(first.parse()?);
            rest = others;
        }
        Ok(methods)
    }

    /// A name that methods may have in results.
    ///
    /// # Errors
    /// [`InvalidText`] for another text.
    pub fn name_of(text: &str) -> Result<String, InvalidText> {
        let plain = |c: char| c.is_alphanumeric() || "-_.+ ".contains(c);
        let name = text.trim();
        if !name.is_empty() && name.chars().all(plain) && ![TRUTH, CONTEXT].contains(&name) {
            return Ok(name.to_owned());
        }
        let expected = "a name of letters, digits, spaces, - _ . and +, other than truth and context";
        Err(InvalidText::new(expected, text))
    }
}

/// Name and method of `NAME=METHOD`; a method may contain an equals sign after its colon. The last one before it ends the name, so
/// that a name with another one is rejected as a name.
fn parts(text: &str) -> (Option<&str>, &str) {
    let kind = text.split([':', ',']).next().unwrap_or(text);
    let name = kind.rsplit_once('=').map(|(name, _)| name);
    let method = name.and_then(|name| text.strip_prefix(name)?.strip_prefix('='));
    method.map_or((None, text), |method| (name, method))
}

impl FromStr for MethodSpec {
    type Err = InvalidMethod;

    fn from_str(text: &str) -> Result<Self, InvalidMethod> {
        let (name, method) = parts(text);
        let name = name.map(Self::name_of).transpose()?;
        let kind = MethodKind::parse(method)?.ok_or_else(|| {
            let expected = "atsplat, nearest-view, warp, renders:DIR, ply:DIR, exec:COMMAND, or 3dgs, mip-splatting, mcmc or \
                            atsplat+refine with a budget such as 3dgs:3000 (steps) or mcmc:10s, optionally after NAME=";
            InvalidText::new(expected, text)
        })?;
        let is_baseline = matches!(kind, MethodKind::NearestView | MethodKind::Warp);
        if is_baseline && name.is_some() {
            return Err(InvalidMethod::Named { method: method.to_owned(), found: text.to_owned() });
        }
        Ok(Self { name, kind })
    }
}

#[cfg(test)]
mod tests {
    use atsplat_results::RecordKind;

    use super::*;

    /// Otherwise tables reject `kind = "…"`, and images from outside are not checked for mistakes in writing them.
    #[test]
    fn every_method_has_a_kind_of_records_and_is_named_in_errors() {
        let error = "none".parse::<MethodSpec>().unwrap_err().to_string();
        for name in MethodKind::names() {
            assert_ne!(RecordKind::of(name), RecordKind::Other, "{name}: crates/results/src/rows/record_kind.rs");
            assert!(error.contains(name), "{name}: {error}");
        }
    }

    /// As in the label of a hyperparameter.
    #[test]
    fn an_equals_sign_in_a_name_is_the_names_fault() {
        for (text, name) in [
            ("ours k=4=exec:venv/bin/python knob.py --k=4", "ours k=4"),
            ("k=4=renders:out/k=4", "k=4"),
            ("a=b=c=warp", "a=b=c"),
            ("warp,k=4=ply:out", "k=4"),
        ] {
            let error = MethodSpec::list(text).unwrap_err().to_string();
            let expected =
                format!("a name of letters, digits, spaces, - _ . and +, other than truth and context, found {name:?}");
            assert!(error.ends_with(&expected), "{error}");
        }
        let unknown = "k=4=".parse::<MethodSpec>().unwrap_err().to_string();
        assert!(unknown.contains("a name of letters"), "{unknown}");
        assert_eq!(parts("warp,k=exec:a --b=1"), (None, "warp,k=exec:a --b=1"));
        assert_eq!(parts("exec:a --b=1"), (None, "exec:a --b=1"));
    }

    #[test]
    fn parses_methods_with_optional_names() {
        let method = |name: Option<&str>, kind| Ok(MethodSpec { name: name.map(str::to_owned), kind });
        assert_eq!("atsplat".parse(), method(None, MethodKind::AtSplat));
        assert_eq!("small=atsplat".parse(), method(Some("small"), MethodKind::AtSplat));
        assert_eq!("renders:a/b".parse(), method(None, MethodKind::Renders("a/b".into())));
        assert_eq!("MVSplat=ply:out:1".parse(), method(Some("MVSplat"), MethodKind::Ply("out:1".into())));
        assert_eq!("mcmc:10s".parse(), method(None, MethodKind::Optimised(Strategy::Mcmc, Budget::Seconds(10.0))));
        assert_eq!("long=atsplat+refine:300".parse(), method(Some("long"), MethodKind::Refined(Budget::Steps(300))));
        assert_eq!("exec:a --b=1".parse(), method(None, MethodKind::Exec("a --b=1".to_owned())));
        assert_eq!("x=exec:a --b=1".parse(), method(Some("x"), MethodKind::Exec("a --b=1".to_owned())));
        let list = MethodSpec::list;
        let methods = list("warp,x=renders:a,y=exec:b 1,2").unwrap();
        assert_eq!(methods[1], method(Some("x"), MethodKind::Renders("a".into())).unwrap());
        assert_eq!(methods[2..], [method(Some("y"), MethodKind::Exec("b 1,2".to_owned())).unwrap()]);
        assert!(list("warp,").is_err() && list("exec: ").is_err() && list("").is_err());
        for broken in ["3dgs", "3dgs:", "3dgs:0", "mcmc:-1s", "mip-splatting:ten", "3dgs:1.5", "fixed:3"] {
            assert!(broken.parse::<MethodSpec>().is_err(), "{broken:?}");
        }
        for broken in
            ["", "splat", "renders", "renders:", "=warp", "x=warp", "truth=renders:a", " truth =warp", "a/b=renders:c"]
        {
            assert!(broken.parse::<MethodSpec>().is_err(), "{broken:?}");
        }
    }
}
