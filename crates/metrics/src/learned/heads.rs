use atsplat_model::weights::StoredTensors;
use atsplat_pickle::SharedBytes;

use super::{LoadError, Network};

/// LPIPS's heads v0.1 (BSD-2, `weights/LICENSE.lpips`), from the files of the lpips package 0.1.4 by
/// `oracle/make_heads.py`.
const VGG: &[u8] = include_bytes!("../../weights/lpips-v0.1-vgg.safetensors");
const ALEX: &[u8] = include_bytes!("../../weights/lpips-v0.1-alex.safetensors");

/// The heads that the crate carries; `None` for ST-LPIPS, whose one file holds everything.
///
/// # Errors
/// None that its tests have not met: the bytes are part of the program.
pub fn carried(network: Network) -> Option<Result<StoredTensors, LoadError>> {
    let bytes = match network {
        Network::LpipsVgg => VGG,
        Network::LpipsAlex => ALEX,
        Network::StLpipsAlex | Network::StLpipsVgg => return None,
    };
    Some(StoredTensors::parse(SharedBytes::new(bytes)).map_err(LoadError::from))
}
