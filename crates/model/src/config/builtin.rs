macro_rules! texts {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../../../eval/models/", $name, ".toml")))),*]
    };
}

/// The configurations that travel inside the binary.
pub(super) const TEXTS: &[(&str, &str)] =
    texts!["paper-re10k", "paper-dl3dv", "paper-dl3dv-224", "paper-dl3dv-hr", "mini", "micro", "nano"];
