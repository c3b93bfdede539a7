macro_rules! texts {
    ($folder:literal, $ending:literal, $($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../../../eval/", $folder, "/", $name, $ending)))),*]
    };
}

/// The tables embedded in the binary, in the order of a report: name and TOML text.
pub(super) const TABLES: &[(&str, &str)] = texts![
    "tables",
    ".toml",
    "re10k",
    "re10k_overlap",
    "dl3dv",
    "dl3dv_hr",
    "dl3dv_224",
    "cross_dataset",
    "extrapolation",
    "ablation_anchor",
    "ablation_anchor_dl3dv",
    "ablation_ate",
    "ablation_ate_dl3dv",
    "k_scaling",
    "dynamic_budget",
    "unified",
    "budget",
];

/// The embedded files of published numbers: name and CSV text.
pub(super) const PUBLISHED: &[(&str, &str)] = texts![
    "published",
    "",
    "re10k.csv",
    "re10k_overlap.csv",
    "dl3dv.csv",
    "dl3dv_hr.csv",
    "dl3dv_224.csv",
    "cross_dataset.csv",
    "extrapolation.csv",
    "ablation_anchor.csv",
    "ablation_anchor_dl3dv.csv",
    "ablation_ate.csv",
    "ablation_ate_dl3dv.csv",
    "k_scaling.csv",
    "dynamic_budget.csv",
    "unified.csv",
    "budget.csv",
];
