//! Writes a contact sheet: one row per scene with views along its path, then depth, normals and instances of the last view.
//!
//! `cargo run --release -p atsplat-rooms --example contact_sheet -- rooms train 0 8 sheet.png [side]`

#![expect(clippy::print_stdout, reason = "an example prints what it shows")]

use anyhow::{Context, bail};
use atsplat_camera::ImageSize;
use atsplat_pixels::{Image, Rounding, encode_png};
use atsplat_rooms::{Geometry, Request, SceneKind, SceneSeed, Simulation, Split};

const VIEWS: usize = 5;

fn main() -> anyhow::Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [kind, split, first, count, file, rest @ ..] = args.as_slice() else {
        bail!("usage: contact_sheet rooms|yards train|test FIRST COUNT FILE.png [SIDE]")
    };
    let kind = if kind == "yards" { SceneKind::Yards } else { SceneKind::Rooms };
    let split = if split == "test" { Split::Test } else { Split::Train };
    let (first, count): (u32, u32) = (first.parse()?, count.parse()?);
    let side: u32 = rest.first().map_or(Ok(160), |side| side.parse())?;
    let width = side * (u32::try_from(VIEWS)? + 3);
    let mut sheet = Vec::new();
    for number in first..first + count {
        let request = Request::new(kind, SceneSeed { split, number });
        let simulation = Simulation::new(Request { size: ImageSize { width: side, height: side }, ..request })?;
        println!("{simulation}");
        print!("{}", simulation.costs(0)?);
        let last = simulation.shots().len() - 1;
        let mut tiles: Vec<Image> =
            (0..VIEWS).map(|view| simulation.image(view * last / (VIEWS - 1))).collect::<Result<_, _>>()?;
        tiles.extend(shown(&simulation.geometry(last)?)?);
        for row in 0..side {
            for tile in &tiles {
                let start = (row * side * 3) as usize;
                let samples = tile.samples().get(start..start + (side * 3) as usize);
                sheet.extend_from_slice(samples.context("a row of a tile")?);
            }
        }
    }
    std::fs::write(file, encode_png(&Image::new(width, side * count, sheet)?.to_u8(Rounding::Nearest)?)?)?;
    Ok(())
}

/// Inverse depth, normals and instances as colours.
fn shown(geometry: &Geometry) -> anyhow::Result<[Image; 3]> {
    let ImageSize { width, height } = geometry.size;
    let colours = |samples: Vec<f32>| Image::new(width, height, samples);
    let hashed = |instance: u32, channel: u32| {
        (instance.wrapping_mul(2_654_435_761).rotate_left(channel * 9) % 256) as f32 / 255.0
    };
    Ok([
        colours(geometry.depth.iter().flat_map(|depth| [(0.8 / depth).clamp(0.0, 1.0).sqrt(); 3]).collect())?,
        colours(geometry.normals.iter().flatten().map(|n| 0.5 + 0.5 * n).collect())?,
        colours(geometry.instances.iter().flat_map(|&id| [hashed(id, 0), hashed(id, 1), hashed(id, 2)]).collect())?,
    ])
}
