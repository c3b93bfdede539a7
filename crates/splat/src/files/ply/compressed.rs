//! PlayCanvas' compressed PLY: 16 bytes per Gaussian, quantised within chunks of 256 (playcanvas/splat-transform
//! `src/lib/readers/decompress-ply.ts`, `src/lib/writers/compressed-chunk.ts`).
//!
//! Centres and log-scales have 11, 10 and 11 bits between the chunk's minimum and maximum; a quaternion is the index of
//! its largest component (2 bits) and the other three, 10 bits each over ±√½; a colour has 8 bits per channel between
//! the chunk's minimum and maximum (older files: [0, 1]) and 8 bits of opacity. Element `sh` holds `f_rest` as bytes
//! over ±4.

use super::gaussians::sh_degree;
use super::header::{Element, Header, Kind, Scalar};
use super::{Body, Format, Malformed, Stored, interleaved};
use crate::GaussianParts;
use crate::files::{dc, finite_logit, with_largest_component};

const CHUNK: u64 = 256;
const PACKED: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];

pub(super) fn matches(header: &Header<'_>) -> bool {
    header.element("chunk").is_some()
        && header.element("vertex").is_some_and(|vertex| vertex.scalar(PACKED[0]).is_some())
}

pub(super) fn read(header: &Header<'_>, body: &mut Body<'_>) -> Result<Stored, Malformed> {
    let count = |name| header.element(name).map_or(0, |element| element.count);
    let (chunks, vertices) = (count("chunk"), count("vertex"));
    if chunks != vertices.div_ceil(CHUNK) {
        let expected = format!("{} chunks of {CHUNK} for {vertices} rows", vertices.div_ceil(CHUNK));
        return Err(Malformed::new("element \"chunk\"", expected, chunks.to_string()));
    }
    let sh = header.element("sh");
    if let Some(sh) = sh.filter(|sh| sh.count != vertices) {
        return Err(Malformed::new("element \"sh\"", format!("{vertices} rows"), sh.count.to_string()));
    }
    let degree = sh_degree(sh.map_or(0, |sh| sh.properties.len()))?;
    let columns_by_element = header.elements.iter().map(required_columns).collect::<Result<Vec<_>, _>>()?;

    // The elements may come in any order, so vertices are unpacked after all have been read.
    let (mut chunks, mut vertices, mut rest) = (Vec::new(), Vec::new(), Vec::new());
    for (element, columns) in header.elements.iter().zip(&columns_by_element) {
        match element.name {
            "chunk" => body.rows(element, columns, |row| chunks.push(Chunk::of(row)))?,
            "vertex" => body.rows(element, columns, |row| vertices.push(packed(row)))?,
            "sh" => body.rows(element, columns, |row| rest.extend(row.iter().map(|byte| coefficient(*byte))))?,
            _ => body.skip(element)?,
        }
    }
    let mut parts = GaussianParts { sh_degree: degree, ..GaussianParts::default() };
    let per_channel = crate::sh_coefficients(degree) - 1;
    let mut rest = rest.chunks_exact((3 * per_channel).max(1));
    // Without an element `sh` only the first coefficient is stored; with it, there is one row per vertex.
    let mut higher = || {
        if per_channel == 0 { &[] } else { rest.next().unwrap_or_else(|| unreachable!("`sh` has a row per vertex")) }
    };
    for (vertices, chunk) in vertices.chunks(256).zip(&chunks) {
        for vertex in vertices {
            chunk.unpack(*vertex, &mut parts);
            parts.sh.extend(interleaved(higher(), per_channel));
        }
    }
    let elements = header.elements.iter().zip(&columns_by_element);
    let unused = elements.flat_map(|(element, columns)| unused(element, columns)).collect();
    let antialiased = header.antialiased;
    Ok(Stored { parts, format: Format::CompressedPly, unused, integers: Vec::new(), antialiased })
}

/// An element that is not read, or the properties of another that are not.
fn unused(element: &Element<'_>, columns: &[usize]) -> Vec<String> {
    if !["chunk", "vertex", "sh"].contains(&element.name) {
        return vec![format!("element {}", element.name)];
    }
    let others = element.properties.iter().enumerate().filter(|(at, _)| !columns.contains(at));
    others.map(|(_, property)| format!("property {} of element {}", property.name, element.name)).collect()
}

/// Names of a chunk's ranges, in triples of minima and maxima.
fn range_names(has_colours: bool) -> Vec<String> {
    let groups = [("", "xyz"), ("scale_", "xyz"), ("", "rgb")];
    let ends =
        groups.into_iter().take(if has_colours { 3 } else { 2 }).flat_map(|group| [("min", group), ("max", group)]);
    ends.flat_map(|(end, (prefix, axes))| axes.chars().map(move |axis| format!("{end}_{prefix}{axis}"))).collect()
}

/// Indices of the required properties of an element. A range of one colour requires those of all.
fn required_columns(element: &Element<'_>) -> Result<Vec<usize>, Malformed> {
    let (names, kind) = match element.name {
        "chunk" => {
            let has_colours = range_names(true).iter().skip(12).any(|name| element.scalar(name).is_some());
            (range_names(has_colours), None)
        }
        "vertex" => (PACKED.map(str::to_owned).to_vec(), Some((Scalar::U32, "uint"))),
        "sh" => ((0..element.properties.len()).map(|k| format!("f_rest_{k}")).collect(), Some((Scalar::U8, "uchar"))),
        _ => (Vec::new(), None),
    };
    let position = |name: &String| {
        let at = element.required(name)?;
        let found = element.properties.get(at).map(|property| property.kind);
        match kind {
            // Packed and quantised numbers have no meaning in another type.
            Some((scalar, type_name)) if found != Some(Kind::Scalar(scalar)) => {
                let location = format!("element \"{}\"", element.name);
                Err(Malformed::new(location, format!("{name} as {type_name}"), "another type"))
            }
            _ => Ok(at),
        }
    };
    names.iter().map(position).collect()
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the file's own u32 in an f64")]
fn packed(row: &[f64]) -> [u32; 4] {
    let row = row.first_chunk().unwrap_or_else(|| unreachable!("four properties are read"));
    row.map(|value: f64| value as u32)
}

/// Maps 0 and 255 to the ends of the range, and the rest to the middles of 256 steps.
#[expect(clippy::cast_possible_truncation, reason = "coefficients are stored as f32")]
fn coefficient(byte: f64) -> f32 {
    let share = if byte <= 0.0 {
        0.0
    } else if byte >= 255.0 {
        1.0
    } else {
        (byte + 0.5) / 256.0
    };
    ((share - 0.5) * 8.0) as f32
}

/// Value ranges of a chunk of 256 Gaussians.
struct Chunk {
    means: Range,
    log_scales: Range,
    colours: Range,
}

/// Minimum and maximum per axis or channel.
struct Range([f64; 3], [f64; 3]);

impl Chunk {
    fn of(row: &[f64]) -> Self {
        let mut triples = row.as_chunks::<3>().0.iter().copied();
        let mut range = |or: Range| match (triples.next(), triples.next()) {
            (Some(min), Some(max)) => Range(min, max),
            _ => or,
        };
        let unit = || Range([0.0; 3], [1.0; 3]);
        Self { means: range(unit()), log_scales: range(unit()), colours: range(unit()) }
    }

    #[expect(clippy::cast_possible_truncation, reason = "Gaussians are stored as f32")]
    fn unpack(&self, [position, rotation, scale, colour]: [u32; 4], parts: &mut GaussianParts) {
        let narrow = |value: f64| value as f32;
        parts.means.push(self.means.between(fractions_11_10_11(position)).map(narrow));
        parts.log_scales.push(self.log_scales.between(fractions_11_10_11(scale)).map(narrow));
        parts.quaternions.push(quaternion(rotation).map(narrow));
        let [red, green, blue, opacity] = [24, 16, 8, 0].map(|shift| fraction(colour >> shift, 8));
        parts.sh.push(self.colours.between([red, green, blue]).map(dc));
        parts.opacity_logits.push(finite_logit(opacity));
    }
}

impl Range {
    fn between(&self, shares: [f64; 3]) -> [f64; 3] {
        let Self([min_x, min_y, min_z], [max_x, max_y, max_z]) = self;
        let [x, y, z] = shares;
        let mix = |min: &f64, max: &f64, share: f64| min * (1.0 - share) + max * share;
        [mix(min_x, max_x, x), mix(min_y, max_y, y), mix(min_z, max_z, z)]
    }
}

fn fractions_11_10_11(packed: u32) -> [f64; 3] {
    [fraction(packed >> 21, 11), fraction(packed >> 11, 10), fraction(packed, 11)]
}

/// The lowest bits, divided by their largest value.
fn fraction(packed: u32, bits: u32) -> f64 {
    let largest = (1 << bits) - 1;
    f64::from(packed & largest) / f64::from(largest)
}

fn quaternion(packed: u32) -> [f64; 4] {
    let others = [20, 10, 0].map(|shift| (fraction(packed >> shift, 10) - 0.5) * std::f64::consts::SQRT_2);
    with_largest_component(packed >> 30, others)
}
