use atsplat_files::Embedded;

macro_rules! embedded {
    ($($name:literal),* $(,)?) => {
        /// The tables embedded in the binary, in the order of a report: the TOML texts in `eval/tables`.
        pub(super) const TABLES: Embedded =
            Embedded(&[$(($name, include_str!(concat!("../../../../eval/tables/", $name, ".toml")))),*]);

        /// Their published numbers: the CSV texts in `eval/published`.
        pub(super) const PUBLISHED: Embedded = Embedded(&[
            $((concat!($name, ".csv"), include_str!(concat!("../../../../eval/published/", $name, ".csv")))),*
        ]);
    };
}

embedded![
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
