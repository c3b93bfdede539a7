//! Any bytes as a scene: what the fuzz target `scenes` renders, and the ordinary tests replay.

use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_splat::{
    Channels, Exposure, GaussianParts, Gaussians, RasterMode, RenderOptions, RendererConstants, StoppedGradients, View,
    sh_coefficients,
};
use glam::{DMat3, DVec3};

/// More would only slow the fuzzer down.
const MAX_GAUSSIANS: usize = 48;
const LONGEST_SIDE: u32 = 24;

/// Reads a scene from bytes, zeros where they end: switches, the camera, then as many Gaussians as the bytes hold.
/// `None` where the camera is none.
pub(crate) fn scene_of_bytes(bytes: &[u8]) -> Option<(Gaussians, View, RenderOptions)> {
    let mut reader = Reader(bytes);
    let [preset, switches, degree, max_degree] = [(); 4].map(|()| reader.byte());
    let size = ImageSize {
        width: u32::from(reader.byte()) % LONGEST_SIDE + 1,
        height: u32::from(reader.byte()) % LONGEST_SIDE + 1,
    };
    let switch = |bit: u8| switches >> bit & 1 == 1;
    let names: Vec<&str> = RendererConstants::preset_names().collect();
    let name = names[usize::from(preset) % names.len()];
    let exposure = Exposure { matrix: [(); 3].map(|()| reader.wide()), offset: reader.wide() };
    let options = RenderOptions {
        constants: RendererConstants::named(name)?,
        background: reader.wide(),
        mode: if switch(0) { RasterMode::Antialiased } else { RasterMode::Classic },
        max_sh_degree: max_degree % 5,
        exposure: switch(1).then_some(exposure),
        channels: Channels { depth: switch(2), scalar: switch(3), median_depth: switch(4) },
        gradients: StoppedGradients { scalar_stops: switch(5), directions_stop: switch(6) },
        ..RenderOptions::default()
    };
    let view = View { camera: camera(&mut reader)?, size };
    Some((gaussians(&mut reader, degree), view, options))
}

fn camera(reader: &mut Reader<'_>) -> Option<Camera> {
    let lens = reader.byte();
    let turn = DVec3::from_array(reader.wide());
    let rotation = DMat3::from_rotation_z(turn.z) * DMat3::from_rotation_y(turn.y) * DMat3::from_rotation_x(turn.x);
    let camera_from_world = CameraFromWorld::new(rotation, DVec3::from_array(reader.wide())).ok()?;
    let [fx, fy, cx, cy] = reader.wide();
    let [k1, k2, k3, p1, p2] = reader.wide();
    let distortion = match lens % 3 {
        0 => Distortion::None,
        1 => Distortion::OpenCv { k1, k2, k3, p1, p2 },
        _ => Distortion::Fisheye { k: [k1, k2, k3, p1] },
    };
    Some(Camera { camera_from_world, intrinsics: NormalizedIntrinsics::new(fx, fy, cx, cy).ok()?, distortion })
}

fn gaussians(reader: &mut Reader<'_>, switches: u8) -> Gaussians {
    let mut parts = GaussianParts {
        sh_degree: switches % 5,
        scalars: (switches & 8 != 0).then(Vec::new),
        filter_3d: (switches & 16 != 0).then(Vec::new),
        ..GaussianParts::default()
    };
    while !reader.0.is_empty() && parts.means.len() < MAX_GAUSSIANS {
        parts.means.push(reader.floats());
        parts.quaternions.push(reader.floats());
        parts.log_scales.push(reader.floats());
        let [logit, scalar, filter] = reader.floats();
        parts.opacity_logits.push(logit);
        parts.scalars.iter_mut().for_each(|scalars| scalars.push(scalar));
        parts.filter_3d.iter_mut().for_each(|filters| filters.push(filter));
        parts.sh.extend((0..sh_coefficients(parts.sh_degree)).map(|_| reader.floats::<3>()));
    }
    Gaussians::new(parts).unwrap_or_default()
}

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    fn floats<const N: usize>(&mut self) -> [f32; N] {
        [(); N].map(|()| f32::from_le_bytes([(); 4].map(|()| self.byte())))
    }

    fn wide<const N: usize>(&mut self) -> [f64; N] {
        self.floats().map(f64::from)
    }
}
