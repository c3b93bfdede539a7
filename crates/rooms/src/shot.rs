use atsplat_camera::{Camera, WorldFromCamera};

/// One camera of a simulated clip, before its picture is rendered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// Time since the clip's start, in microseconds, as in an RE10K trajectory.
    pub timestamp_micros: i64,
    /// Pose and pinhole; the lens is among the scene's effects.
    pub camera: Camera,
    /// The pose one frame later, towards which the camera moves while the shutter is open.
    pub moving_to: WorldFromCamera,
}

impl Shot {
    /// A camera at rest.
    pub const fn still(timestamp_micros: i64, camera: Camera, pose: WorldFromCamera) -> Self {
        Self { timestamp_micros, camera, moving_to: pose }
    }
}
