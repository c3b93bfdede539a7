use std::fmt::{self, Display, Formatter};

/// A field of [`Gradients`](crate::Gradients).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GradientField {
    /// Of the means.
    Means,
    /// Of the quaternions.
    Quaternions,
    /// Of the log-scales.
    LogScales,
    /// Of the opacity logits.
    OpacityLogits,
    /// Of the spherical-harmonics coefficients.
    Sh,
    /// Of the scalars.
    Scalars,
    /// Of the projected means.
    Means2d,
    /// Of the conics.
    Conics,
    /// Of the background.
    Background,
    /// Of the camera's pose.
    Pose,
}

impl GradientField {
    /// The field's name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Means => "means",
            Self::Quaternions => "quaternions",
            Self::LogScales => "log_scales",
            Self::OpacityLogits => "opacity_logits",
            Self::Sh => "sh",
            Self::Scalars => "scalars",
            Self::Means2d => "means_2d",
            Self::Conics => "conics",
            Self::Background => "background",
            Self::Pose => "pose",
        }
    }

    /// Whether each Gaussian has values of its own in it.
    pub const fn is_of_gaussians(self) -> bool {
        !matches!(self, Self::Background | Self::Pose)
    }
}

impl Display for GradientField {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
