//! The properties of 3DGS (graphdeco-inria/gaussian-splatting `scene/gaussian_model.py`), Mip-Splatting's
//! `filter_3D` (autonomousvision/mip-splatting, same file) and ATSplat's `uncertainty`.

use super::header::{Element, Header, Kind, Scalar};
use super::{Body, Format, Malformed, Stored, interleaved};
use crate::{GaussianParts, MAX_SH_DEGREE, sh_coefficients};

/// Required properties, in the order in which rows are read.
const REQUIRED: [&str; 14] = [
    "x", "y", "z", "rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1", "scale_2", "opacity", "f_dc_0", "f_dc_1",
    "f_dc_2",
];
/// Written as zeros by 3DGS; always ignored.
const NORMALS: [&str; 3] = ["nx", "ny", "nz"];
/// Mip-Splatting's smoothing filter.
pub(super) const FILTER: &str = "filter_3D";
/// The additional scalar.
pub(super) const UNCERTAINTY: &str = "uncertainty";

pub(super) fn read(header: &Header<'_>, body: &mut Body<'_>) -> Result<Stored, Malformed> {
    let vertex = header.element("vertex");
    let vertex = vertex.ok_or_else(|| Malformed::new("header", "an element vertex", "none"))?;
    let columns = Columns::of(vertex)?;
    let mut parts = GaussianParts::default();
    for element in &header.elements {
        if element.name == "vertex" {
            parts = columns.start(body.check_length(element)?);
            body.rows(element, &columns.requested, |row| columns.push(row, &mut parts))?;
        } else {
            body.skip(element)?;
        }
    }
    let others = header.elements.iter().filter(|element| element.name != "vertex");
    let unused = columns.unused.iter().map(|name| format!("property {name}"));
    let unused = unused.chain(others.map(|element| format!("element {}", element.name))).collect();
    let format = Format::Ply(header.encoding);
    Ok(Stored { parts, format, unused, integers: columns.integers, antialiased: header.antialiased })
}

/// Columns to read from a row: the required ones, then `f_rest`, then the optional ones.
struct Columns {
    requested: Vec<usize>,
    sh_degree: u8,
    has_filter: bool,
    has_scalar: bool,
    unused: Vec<String>,
    /// See [`crate::files::ImportReport::integers`].
    integers: Vec<String>,
}

impl Columns {
    fn of(vertex: &Element<'_>) -> Result<Self, Malformed> {
        let mut requested = Vec::new();
        for name in REQUIRED {
            requested.push(vertex.required(name)?);
        }
        let rest = vertex.properties.iter().filter(|property| property.name.starts_with("f_rest_")).count();
        let sh_degree = sh_degree(rest)?;
        for k in 0..rest {
            requested.push(vertex.required(&format!("f_rest_{k}"))?);
        }
        let (filter, scalar) = (vertex.scalar(FILTER), vertex.scalar(UNCERTAINTY));
        requested.extend(filter);
        requested.extend(scalar);
        let is_unused = |at: usize, name: &str| !requested.contains(&at) && !NORMALS.contains(&name);
        let names = vertex.properties.iter().enumerate().filter(|(at, property)| is_unused(*at, property.name));
        let unused = names.map(|(_, property)| property.name.to_owned()).collect();
        let integers = integers(vertex, &requested);
        Ok(Self { requested, sh_degree, has_filter: filter.is_some(), has_scalar: scalar.is_some(), unused, integers })
    }

    /// Empty arrays with capacity for `count` Gaussians.
    fn start(&self, count: usize) -> GaussianParts {
        GaussianParts {
            means: Vec::with_capacity(count),
            quaternions: Vec::with_capacity(count),
            log_scales: Vec::with_capacity(count),
            opacity_logits: Vec::with_capacity(count),
            sh_degree: self.sh_degree,
            sh: Vec::with_capacity(count * sh_coefficients(self.sh_degree)),
            scalars: self.has_scalar.then(|| Vec::with_capacity(count)),
            filter_3d: self.has_filter.then(|| Vec::with_capacity(count)),
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "Gaussians are stored as f32")]
    #[expect(clippy::expect_used, reason = "a row has every required property")]
    fn push(&self, row: &[f64], parts: &mut GaussianParts) {
        let (required, optional) = row.split_first_chunk().expect("a row begins with the required properties");
        let [x, y, z, w, i, j, k, s0, s1, s2, opacity, red, green, blue] = required;
        let narrow = |value: &f64| *value as f32;
        parts.means.push([x, y, z].map(narrow));
        parts.quaternions.push([w, i, j, k].map(narrow));
        parts.log_scales.push([s0, s1, s2].map(narrow));
        parts.opacity_logits.push(narrow(opacity));
        parts.sh.push([red, green, blue].map(narrow));
        let per_channel = sh_coefficients(self.sh_degree) - 1;
        let (rest, optional) = optional.split_at(3 * per_channel);
        parts.sh.extend(interleaved(rest, per_channel).map(|rgb| rgb.map(|value| narrow(&value))));
        let mut optional = optional.iter().map(narrow);
        for column in [&mut parts.filter_3d, &mut parts.scalars].into_iter().flatten() {
            column.extend(optional.next());
        }
    }
}

/// The properties of each integer type.
fn integers(vertex: &Element<'_>, requested: &[usize]) -> Vec<String> {
    const NAMED: usize = 3;
    let of_type = |scalar: Scalar| {
        let read = requested.iter().filter_map(|at| vertex.properties.get(*at));
        let names = read.filter(|property| property.kind == Kind::Scalar(scalar)).map(|property| property.name);
        let names: Vec<&str> = names.collect();
        let (first, others) = names.split_at_checked(NAMED).unwrap_or((&names, &[]));
        let (first, scalar) = (first.join(", "), scalar.name());
        match (names.len(), others.len()) {
            (0, _) => None,
            (1, _) => Some(format!("{first} is stored as {scalar}")),
            (_, 0) => Some(format!("{first} are stored as {scalar}")),
            (_, more) => Some(format!("{first} and {more} more are stored as {scalar}")),
        }
    };
    Scalar::INTEGERS.into_iter().filter_map(of_type).collect()
}

/// The SH degree with this many coefficients above degree 0, over all channels.
pub(super) fn sh_degree(rest: usize) -> Result<u8, Malformed> {
    (0..=MAX_SH_DEGREE).find(|degree| 3 * (sh_coefficients(*degree) - 1) == rest).ok_or_else(|| {
        let expected = "0, 9, 24, 45 or 72 properties f_rest_*, for degrees 0 to 4";
        Malformed::new("header", expected, rest.to_string())
    })
}
