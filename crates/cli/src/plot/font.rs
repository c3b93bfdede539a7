use std::sync::OnceLock;

use anyhow::anyhow;
use plotters::style::{FontStyle, register_font};

/// Name under which the bundled font is registered.
pub(crate) const FONT: &str = "atsplat";

/// Registers the bundled `DejaVu` Sans; plotters without a system font library knows no other.
pub(crate) fn register() -> anyhow::Result<()> {
    static OUTCOME: OnceLock<bool> = OnceLock::new();
    let registered = *OUTCOME.get_or_init(|| {
        register_font(FONT, FontStyle::Normal, dejavu::sans::regular()).is_ok()
            && register_font(FONT, FontStyle::Bold, dejavu::sans::bold()).is_ok()
    });
    if registered { Ok(()) } else { Err(anyhow!("the bundled font cannot be read")) }
}
