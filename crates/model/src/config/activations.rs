use serde::{Deserialize, Serialize};

/// Activation of a raw output `x` as a depth: distance along the unit ray, in scene units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
pub enum DepthActivation {
    /// `near · (far / near)^σ(x + shift)`: near and far are equally easy to reach, and `shift` sets the depth at which
    /// training from scratch starts.
    LogSigmoid {
        /// Least depth.
        near: f64,
        /// Greatest depth.
        far: f64,
        /// Added to `x`.
        shift: f64,
    },
    /// `near + (far − near) · σ(x + shift)`: iLRM and Long-LRM, with 0 and 500 (`scalable/scaler.py:170`).
    Sigmoid {
        /// Least depth.
        near: f64,
        /// Greatest depth.
        far: f64,
        /// Added to `x`.
        shift: f64,
    },
    /// `1 / (1/far + (1/near − 1/far) · σ(x + shift))`: DepthSplat's inverse depth.
    InverseSigmoid {
        /// Least depth.
        near: f64,
        /// Greatest depth.
        far: f64,
        /// Added to `x`.
        shift: f64,
    },
    /// `e^(x + shift)`: DUSt3R and VGGT (`vggt/heads/head_act.py`).
    Exp {
        /// Added to `x`.
        shift: f64,
    },
}

/// Activation of raw outputs as an offset, or as a centre in designs without anchors; in scene units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
pub enum OffsetActivation {
    /// `gain · x`.
    Linear {
        /// Scene units for an output of 1.
        gain: f64,
    },
    /// `gain · sign(x) · (e^|x| − 1)`: TokenGS.
    InverseLog {
        /// Scene units for an output of 1, before the exponential.
        gain: f64,
    },
}

/// Activation of a raw output as the standard deviation along an axis, in scene units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
pub enum ScaleActivation {
    /// `e^min(x + shift, max)`: iLRM and Long-LRM, with −6.9 and −1.2.
    ExpClamped {
        /// Added to `x`.
        shift: f64,
        /// Greatest logarithm.
        max: f64,
    },
    /// `gain · ln(1 + e^(x + shift))`.
    Softplus {
        /// Added to `x`.
        shift: f64,
        /// Scene units.
        gain: f64,
    },
}

/// Activation of a raw output as an opacity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
pub enum OpacityActivation {
    /// `σ(x + shift)`: iLRM and Long-LRM, with −2.
    Sigmoid {
        /// Added to `x`.
        shift: f64,
    },
}

/// Activation of four raw outputs as a rotation `w, x, y, z`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum QuaternionActivation {
    /// `q / max(|q|, 1e-12)`: iLRM and Long-LRM (PyTorch's `normalize`).
    Normalize,
    /// The same for `q + (1, 0, 0, 0)`, so that outputs near zero give no rotation.
    NormalizeFromIdentity,
}
