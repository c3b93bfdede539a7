//! Words that mean something to the protocol crate, checked before anything is read.

use std::path::Path;

use anyhow::{Context as _, bail};
use atsplat_protocol::overlap::OverlapEstimator;
use atsplat_protocol::{BinRule, IndexBuilder, OverlapBins, Preset, ProtocolError};

/// A preset's name, or the path of one. A path is read when the work begins: a broken file is no wrong word.
pub(crate) fn preset(text: &str) -> Result<String, ProtocolError> {
    name_or_path(text, Preset::resolve)
}

/// A sampling rule's name, or the path of one.
pub(crate) fn sampler(text: &str) -> Result<String, ProtocolError> {
    name_or_path(text, IndexBuilder::resolve)
}

fn name_or_path<T>(text: &str, resolve: impl Fn(&str) -> Result<T, ProtocolError>) -> Result<String, ProtocolError> {
    let is_path = Path::new(text).extension().is_some_and(|extension| extension == "toml");
    if !is_path {
        resolve(text)?;
    }
    Ok(text.to_owned())
}

/// An estimator's name.
pub(super) fn estimator(name: &str) -> anyhow::Result<OverlapEstimator> {
    let text = format!("estimator = {name:?}");
    toml::from_str(&text).map_err(|error| anyhow::anyhow!("{}", error.message()))
}

/// `0.05,small:0.3,medium:0.55,large:0.8`: the lowest edge, then each bin's name and upper edge.
pub(super) fn bins(text: &str) -> anyhow::Result<OverlapBins> {
    let mut parts = text.split(',');
    let mut edges = vec![edge(parts.next().unwrap_or_default())?];
    let mut names = Vec::new();
    for part in parts {
        let Some((name, upper)) = part.split_once(':') else {
            bail!("expected NAME:UPPER, found {part:?}");
        };
        names.push(name.trim().to_owned());
        edges.push(edge(upper)?);
    }
    Ok(OverlapBins::new(BinRule::Published, names, edges)?)
}

fn edge(text: &str) -> anyhow::Result<f64> {
    text.trim().parse().with_context(|| format!("expected a number, found {text:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_as_words() {
        let found = bins("0.05,small:0.3, medium:0.55,large:0.8").unwrap();
        let published = OverlapBins::noposplat(BinRule::Published);
        assert_eq!((found.names(), found.edges()), (published.names(), published.edges()));
        assert_eq!(found.estimator(), None, "the user's bins are for whatever is filed into them");
        for broken in ["", "0.1", "0.1,a", "0.1,a:x", "0.3,a:0.1", "0.1,a:0.2,a:0.3"] {
            assert!(bins(broken).is_err(), "{broken:?}");
        }
    }

    #[test]
    fn estimators_by_name() {
        assert_eq!(estimator("epipolar-ray").unwrap().name(), "epipolar-ray");
        let error = estimator("guess").unwrap_err().to_string();
        assert!(error.contains("epipolar-ray"), "the names are listed: {error}");
    }

    #[test]
    fn names_are_checked_and_paths_are_not() {
        assert!(preset("re10k-2v-256").is_ok() && sampler("re10k-2v").is_ok());
        assert!(preset("nope").is_err() && sampler("nope").is_err());
        assert!(preset("no/such.toml").is_ok() && sampler("no/such.toml").is_ok());
    }
}
