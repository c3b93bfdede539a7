use atsplat_files::Embedded;

macro_rules! texts {
    ($($name:literal),* $(,)?) => {
        Embedded(&[$(($name, include_str!(concat!("../../../../eval/presets/", $name, ".toml")))),*])
    };
}

/// The TOML texts of the presets in `eval/presets/`.
pub(super) const TEXTS: Embedded = texts![
    "re10k-2v-256",
    "re10k-overlap",
    "acid-2v-256",
    "acid-overlap",
    "dl3dv-2v-256x448",
    "dl3dv-4v-256x448",
    "dl3dv-6v-256x448",
    "dl3dv-12v-512x960",
    "dl3dv-6v-224",
    "re10k-to-dl3dv-256",
    "dl3dv-6v-extrapolation",
    "re10k-extrapolation",
    "photos-3v-256",
    "rooms-2v-128",
    "rooms-2v-64",
    "rooms-overlap-128",
    "rooms-extrapolation-128",
    "yards-2v-128x224",
    "yards-4v-128x224",
    "yards-6v-128x224",
    "yards-12v-256x480",
    "yards-6v-112",
    "rooms-to-yards-128",
    "yards-6v-extrapolation",
];
