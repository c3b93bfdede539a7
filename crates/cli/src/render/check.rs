//! Rejects contradicting arguments before any file is read or created.

use super::{Args, FormatArg};
use crate::parse::{names, once, usage_error};
use crate::requirements::{Requirement, check_all};

impl Args {
    pub(super) fn check(&self) -> Result<(), clap::Error> {
        self.consistent().map_err(usage_error)
    }

    fn consistent(&self) -> Result<(), String> {
        let (writes_png, writes_exr) = (self.writes(FormatArg::Png), self.writes(FormatArg::Exr));
        self.views.check()?;
        once("--formats", &names(&self.formats))?;
        once("--round-trip", &self.round_trip.iter().map(|format| format.name().to_owned()).collect::<Vec<_>>())?;
        let planes = names(&self.settings.channels);
        once("--channels", &planes)?;
        // An effect that writes a plane has the same name as the plane.
        let effects = &self.effects.effects;
        if let Some(plane) = planes.iter().find(|plane| !effects.allows(plane)) {
            return Err(format!("--channels {plane}: excluded by --effects {effects}"));
        }
        self.effects.check()?;
        check_all(&[
            Requirement {
                options: &[("--channels", !planes.is_empty())],
                requires: "--formats exr",
                satisfied: writes_exr,
            },
            Requirement {
                options: &[("--rounding", self.rounding.is_some())],
                requires: "--formats png or --preview",
                satisfied: writes_png || self.preview.preview.is_some(),
            },
        ])
    }
}
