//! Rejects contradicting arguments before any file is read or created.

use super::backend::BackendArg;
use super::{Args, FormatArg};
use crate::parse::{names, once, usage_error};

impl Args {
    pub(super) fn check(&self) -> Result<(), clap::Error> {
        self.consistent().map_err(usage_error)
    }

    fn consistent(&self) -> Result<(), String> {
        self.views.check()?;
        once("--formats", &names(&self.formats))?;
        once("--round-trip", &self.round_trip.iter().map(|format| format.name().to_owned()).collect::<Vec<_>>())?;
        let planes = names(&self.settings.channels);
        once("--channels", &planes)?;
        if !planes.is_empty() && !self.writes(FormatArg::Exr) {
            return Err("--channels selects planes of EXR files: add --formats exr".to_owned());
        }
        // An effect that writes a plane has the same name as the plane.
        let effects = &self.effects.effects;
        if let Some(plane) = planes.iter().find(|plane| !effects.allows(plane)) {
            return Err(format!("--channels {plane}: excluded by --effects {effects}"));
        }
        self.effects.check()?;
        if self.rounding.is_some() && !self.writes(FormatArg::Png) && self.preview.preview.is_none() {
            return Err("--rounding is for images of 8 bits: add --formats png or --preview".to_owned());
        }
        if self.adapter.is_some() && self.backend != BackendArg::Gpu {
            return Err("--adapter selects the adapter of --backend gpu: add --backend gpu".to_owned());
        }
        Ok(())
    }
}
