macro_rules! texts {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../../key-maps/", $name, ".toml")))),*]
    };
}

/// The maps that travel inside the binary.
pub(super) const TEXTS: &[(&str, &str)] = texts!["identity", "dinov2-official", "dinov2-hugging-face"];
