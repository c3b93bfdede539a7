//! Words that do not fit together, told before any file is read or made.

use clap::Command;
use clap::error::ErrorKind;

use super::backend::BackendWord;
use super::{FormatWord, Words};
use crate::words::{names, once};

impl Words {
    pub(super) fn check(&self) -> Result<(), clap::Error> {
        self.fit().map_err(|text| Command::new("atsplat").error(ErrorKind::ValueValidation, text))
    }

    fn fit(&self) -> Result<(), String> {
        self.views.check()?;
        once("--formats", &names(&self.formats))?;
        once("--round-trip", &names(&self.round_trip))?;
        let planes = names(&self.look.channels);
        once("--channels", &planes)?;
        if !planes.is_empty() && !self.writes(FormatWord::Exr) {
            return Err("--channels are planes of EXR files: add --formats exr".to_owned());
        }
        // An effect is called as its plane is.
        let effects = &self.effects.effects;
        if let Some(plane) = planes.iter().find(|plane| !effects.allows(plane)) {
            return Err(format!("--channels {plane}: --effects {effects} leaves it out"));
        }
        if self.adapter.is_some() && self.backend != BackendWord::Gpu {
            return Err("--adapter is what --backend gpu renders on: add --backend gpu".to_owned());
        }
        Ok(())
    }
}
