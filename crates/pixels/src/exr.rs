//! EXR files of f32 samples: float renders, depth, uncertainty.
//!
//! EXR is linear by convention, while every paper of the field computes on sRGB-encoded values; so each file written here
//! states the meaning of its values in the string attribute `values` of the header (`R G B: sRGB-encoded
//! display-referred`), which [`read`] returns. Samples round-trip bit for bit, including infinities and NaN.

mod blocks;

use std::fmt;
use std::io::Cursor;

use ::exr::image::read::read as exr_reader;
use ::exr::image::write::WritableImage;
use ::exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image as ExrImage, Layer};
use ::exr::math::Vec2;
use ::exr::meta::attribute::{AttributeValue, Text};
use ::exr::meta::header::{Header, LayerAttributes};
use ::exr::meta::{Headers, MetaData};
use ::exr::prelude::{ReadChannels as _, ReadLayers as _, f16};

use crate::limits::reserved;
use crate::size::header as header_problem;
use crate::{DecodeLimits, Image, ImageFormat, PixelError};

const ATTRIBUTE: &str = "values";
const LONGEST_NAME: usize = 31;

/// The description of a channel `A` if the colours are already composited over their background, so that `A` must not be
/// applied to them.
pub const COMPOSITED: &str = "opacity; R G B are over the background already";

/// The meaning of a channel's values.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Values {
    /// sRGB-encoded, nominally in [0, 1], as in an [`Image`].
    DisplayReferred,
    /// Proportional to light.
    Linear,
    /// Distance along the camera's z axis in scene units.
    Depth,
    /// Anything else, as described in the file.
    Named(String),
    /// Not stated in the file.
    Unstated,
}

impl fmt::Display for Values {
    /// As in the file: `linear`, `depth in scene units`; or `values of no stated kind`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(meaning(self).as_deref().unwrap_or("values of no stated kind"))
    }
}

/// One named plane of an EXR.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// The name in the file: `R`, `Z`, `uncertainty`.
    pub name: String,
    /// The meaning of the samples.
    pub values: Values,
    /// Row-major, height × width.
    pub samples: Vec<f32>,
}

/// Planes of one size, in alphabetical order of their names.
#[derive(Clone, Debug, PartialEq)]
pub struct Channels {
    width: u32,
    height: u32,
    planes: Vec<Channel>,
}

impl Channels {
    /// Channels with planes of `width × height` samples each.
    ///
    /// # Errors
    /// [`PixelError::Empty`] for an image without pixels or channels, [`PixelError::ChannelName`] for a repeated name, and
    /// [`PixelError::ChannelSize`] for a plane of another size.
    pub fn new(width: u32, height: u32, mut channels: Vec<Channel>) -> Result<Self, PixelError> {
        if width == 0 || height == 0 || channels.is_empty() {
            return Err(PixelError::Empty { what: "EXR channels", width, height });
        }
        channels.sort_by(|a, b| a.name.cmp(&b.name));
        let repeated = channels.iter().zip(channels.iter().skip(1)).find(|(a, b)| a.name == b.name);
        if let Some((channel, _)) = repeated {
            return Err(PixelError::ChannelName { name: channel.name.clone(), problem: "it is repeated" });
        }
        let expected = u64::from(width) * u64::from(height);
        if let Some(Channel { name, samples, .. }) = channels.iter().find(|c| c.samples.len() as u64 != expected) {
            return Err(PixelError::ChannelSize { name: name.clone(), expected, found: samples.len() });
        }
        Ok(Self { width, height, planes: channels })
    }

    /// Columns.
    pub const fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub const fn height(&self) -> u32 {
        self.height
    }

    /// All planes, in alphabetical order of their names.
    pub fn channels(&self) -> &[Channel] {
        &self.planes
    }

    /// The plane with this name.
    ///
    /// # Errors
    /// [`PixelError::MissingChannel`], with the existing names.
    pub fn get(&self, name: &str) -> Result<&Channel, PixelError> {
        self.planes.iter().find(|channel| channel.name == name).ok_or_else(|| PixelError::MissingChannel {
            expected: name.to_owned(),
            found: self.planes.iter().map(|channel| channel.name.clone()).collect(),
        })
    }
}

/// Encodes an RGB image as an EXR with f32 channels `R`, `G` and `B`, losslessly compressed (ZIP, 16 rows).
///
/// # Errors
/// [`PixelError::Empty`] for an image without pixels.
pub fn write_rgb(image: &Image, values: &Values) -> Result<Vec<u8>, PixelError> {
    let plane = |name: &str, offset: usize| Channel {
        name: name.to_owned(),
        values: values.clone(),
        samples: image.samples().iter().skip(offset).step_by(3).copied().collect(),
    };
    write(&Channels::new(image.width(), image.height(), vec![plane("R", 0), plane("G", 1), plane("B", 2)])?)
}

/// Decodes the channels `R`, `G` and `B` of an EXR, and the meaning of their values.
///
/// # Errors
/// Those of [`read`], and [`PixelError::MissingChannel`]; [`PixelError::Header`] if the values of the three channels
/// have different meanings.
pub fn read_rgb(bytes: &[u8], limits: &DecodeLimits) -> Result<(Image, Values), PixelError> {
    rgb_of(&read(bytes, limits)?)
}

fn rgb_of(channels: &Channels) -> Result<(Image, Values), PixelError> {
    let [red, green, blue] = [channels.get("R")?, channels.get("G")?, channels.get("B")?];
    if red.values != green.values || red.values != blue.values {
        let found = format!("{:?}, {:?} and {:?}", red.values, green.values, blue.values);
        return Err(header_problem(ImageFormat::Exr, format!("expected R, G and B of one kind, found {found}")));
    }
    let mut samples = reserved("EXR image", channels.width.into(), channels.height.into(), 3)?;
    let planes = red.samples.iter().zip(&green.samples).zip(&blue.samples);
    samples.extend(planes.flat_map(|((r, g), b)| [*r, *g, *b]));
    Ok((Image::new(channels.width, channels.height, samples)?, red.values.clone()))
}

/// [`read_rgb`] for renders, which must be opaque, whole and without losses: a channel `A`, if present, has to be 1 everywhere, or
/// described as [`COMPOSITED`], the only layer has to cover the display window exactly, and its compression has to be lossless.
///
/// # Errors
/// Those of [`read_rgb`]; [`PixelError::UnusableRender`] and [`PixelError::Transparent`].
pub fn read_render(bytes: &[u8], limits: &DecodeLimits) -> Result<(Image, Values), PixelError> {
    require_exact(bytes)?;
    let channels = read(bytes, limits)?;
    let composited = Values::Named(COMPOSITED.to_owned());
    if let Some(alpha) = channels.planes.iter().find(|plane| plane.name == "A" && plane.values != composited) {
        let is_transparent = |(_, alpha): &(usize, &f32)| **alpha < 1.0 || alpha.is_nan();
        let mut transparent = alpha.samples.iter().enumerate().filter(is_transparent);
        if let Some((first, _)) = transparent.next() {
            let (column, row) = (first % channels.width as usize, first / channels.width as usize);
            return Err(PixelError::Transparent { count: 1 + transparent.count(), column, row });
        }
    }
    rgb_of(&channels)
}

/// An error for a file of several layers, any of which may be the image, and for a layer that is a crop of the image, or compressed
/// by a method that may lose digits.
fn require_exact(bytes: &[u8]) -> Result<(), PixelError> {
    let unusable = |expected, found, remedy| Err(PixelError::UnusableRender { expected, found, remedy });
    let headers = headers(bytes)?;
    let [header] = &headers[..] else {
        return unusable("one layer", headers.len().to_string(), "write the image alone");
    };
    if header.compression.may_loose_data() {
        let remedy = "write ZIP or another lossless one: the losses would count as errors of the method";
        return unusable("lossless compression", header.compression.to_string(), remedy);
    }
    let shown = header.shared_attributes.display_window;
    let (position, size) = (header.own_attributes.layer_position, header.layer_size);
    if position == shown.position && size == shown.size {
        return Ok(());
    }
    let window = |at: Vec2<i32>, size: Vec2<usize>| format!("{}×{} at column {}, row {}", size.0, size.1, at.0, at.1);
    let found = format!("{} of an image of {}", window(position, size), window(shown.position, shown.size));
    unusable("all pixels of the display window", found, "write them without cropping")
}

/// Encodes named planes as an EXR, losslessly compressed (ZIP, 16 rows).
///
/// # Errors
/// [`PixelError::ChannelName`] for a name that is not 1 to 31 printable ASCII characters, or contains a colon: the list of
/// meanings separates names by spaces and ends them with a colon. [`PixelError::Encode`].
pub fn write(channels: &Channels) -> Result<Vec<u8>, PixelError> {
    if let Some(Channel { name, .. }) = channels.planes.iter().find(|channel| !is_writable(&channel.name)) {
        let problem = "expected 1 to 31 printable ASCII characters without a colon";
        return Err(PixelError::ChannelName { name: name.clone(), problem });
    }
    let mut attributes = LayerAttributes::default();
    attributes.other.insert(Text::from(ATTRIBUTE), AttributeValue::Text(Text::from(&*description(channels))));
    let planes = channels
        .planes
        .iter()
        .map(|channel| AnyChannel::new(Text::from(&*channel.name), FlatSamples::F32(channel.samples.clone())));
    let size = (channels.width as usize, channels.height as usize);
    let encoding = Encoding::SMALL_LOSSLESS;
    let layer = Layer::new(size, attributes, encoding, AnyChannels::sort(planes.collect()));
    let mut file = Cursor::new(Vec::new());
    ExrImage::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut file)
        .map_err(|source| PixelError::Encode { format: ImageFormat::Exr, source: source.into() })?;
    Ok(file.into_inner())
}

fn is_writable(name: &str) -> bool {
    let printable = name.bytes().all(|byte| byte.is_ascii_graphic() && byte != b':');
    printable && (1..=LONGEST_NAME).contains(&name.len())
}

/// Decodes every f16 and f32 channel of an EXR's first flat layer, at its largest resolution.
///
/// The image is the layer's data window; its position in the display window is ignored, as are other layers. Channels may have any
/// distinct names, such as Blender's `View Layer.Noise`, also those that [`write()`] does not accept.
///
/// # Errors
/// [`PixelError::OverLimit`] before decoding, [`PixelError::Unsupported`] for deep data, subsampled or integer channels,
/// [`PixelError::ChannelName`] for two channels of one name, [`PixelError::Header`] and [`PixelError::Decode`] for corrupt files,
/// such as those without one of their blocks.
pub fn read(bytes: &[u8], limits: &DecodeLimits) -> Result<Channels, PixelError> {
    let format = ImageFormat::Exr;
    let header = first_header(bytes)?;
    let (width, height) = layer_size(&header)?;
    limits.check(format, (width, height), 4 * header.channels.list.len() as u64)?;
    let unsupported = |feature: String| PixelError::Unsupported { format, feature };
    if header.deep {
        return Err(unsupported("deep data".to_owned()));
    }
    if let Some(channel) = header.channels.list.iter().find(|c| c.sampling.0 != 1 || c.sampling.1 != 1) {
        return Err(unsupported(format!("the subsampled channel {}", channel.name)));
    }
    blocks::require_all(bytes, &header)?;
    let reader = exr_reader().no_deep_data().largest_resolution_level().all_channels();
    let reader = reader.first_valid_layer().all_attributes().non_parallel();
    let layer = reader.from_buffered(Cursor::new(bytes)).map_err(failed)?.layer_data;
    if layer.size.0 != width as usize || layer.size.1 != height as usize {
        let found = format!("{}×{}", layer.size.0, layer.size.1);
        return Err(header_problem(format, format!("size {width}×{height}, but the first flat layer has {found}")));
    }
    let description = match layer.attributes.other.get(&Text::from(ATTRIBUTE)) {
        Some(AttributeValue::Text(text)) => text.to_string(),
        _ => String::new(),
    };
    let channels = layer.channel_data.list.into_iter().map(|channel| {
        let name = channel.name.to_string();
        let samples = match channel.sample_data {
            FlatSamples::F32(samples) => samples,
            FlatSamples::F16(samples) => samples.into_iter().map(f16::to_f32).collect(),
            FlatSamples::U32(_) => return Err(unsupported(format!("the integer channel {name}"))),
        };
        Ok(Channel { values: values_of(&name, &description), name, samples })
    });
    let channels = channels.collect::<Result<Vec<_>, _>>()?;
    Channels::new(width, height, channels)
}

/// Columns and rows of the first layer according to the header.
pub(crate) fn size(bytes: &[u8]) -> Result<(u32, u32), PixelError> {
    layer_size(&first_header(bytes)?)
}

fn headers(bytes: &[u8]) -> Result<Headers, PixelError> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false);
    meta.map(|meta| meta.headers).map_err(|error| header_problem(ImageFormat::Exr, error.to_string()))
}

fn first_header(bytes: &[u8]) -> Result<Header, PixelError> {
    let first = headers(bytes)?.into_iter().next();
    first.ok_or_else(|| header_problem(ImageFormat::Exr, "expected a layer, found none"))
}

fn layer_size(header: &Header) -> Result<(u32, u32), PixelError> {
    let side = |length: usize| {
        u32::try_from(length).ok().filter(|&side| side > 0).ok_or_else(|| {
            header_problem(ImageFormat::Exr, format!("expected a side of 1 to 2^32 - 1 pixels, found {length}"))
        })
    };
    Ok((side(header.layer_size.0)?, side(header.layer_size.1)?))
}

fn failed(source: ::exr::error::Error) -> PixelError {
    PixelError::Decode { format: ImageFormat::Exr, source: source.into() }
}

/// One line for each kind of values: the channels' names, a colon, their meaning.
fn description(channels: &Channels) -> String {
    let mut lines: Vec<(String, Vec<&str>)> = Vec::new();
    for channel in &channels.planes {
        let Some(meaning) = meaning(&channel.values) else { continue };
        match lines.iter_mut().find(|(existing, _)| *existing == meaning) {
            Some((_, names)) => names.push(&channel.name),
            None => lines.push((meaning, vec![&channel.name])),
        }
    }
    let line = |(meaning, names): (String, Vec<&str>)| format!("{}: {meaning}", names.join(" "));
    let lines: Vec<String> = lines.into_iter().map(line).collect();
    lines.join("\n")
}

fn values_of(name: &str, description: &str) -> Values {
    let lines = description.lines().filter_map(|line| line.split_once(": "));
    let mut matching = lines.filter(|(names, _)| names.split(' ').any(|candidate| candidate == name));
    match matching.next().map(|(_, meaning)| meaning) {
        None => Values::Unstated,
        Some(DISPLAY_REFERRED) => Values::DisplayReferred,
        Some(LINEAR) => Values::Linear,
        Some(DEPTH) => Values::Depth,
        Some(meaning) => Values::Named(meaning.to_owned()),
    }
}

const DISPLAY_REFERRED: &str = "sRGB-encoded display-referred";
const LINEAR: &str = "linear";
const DEPTH: &str = "depth in scene units";

/// The text in the header; line breaks are replaced, because they would start another channel's line.
fn meaning(values: &Values) -> Option<String> {
    match values {
        Values::DisplayReferred => Some(DISPLAY_REFERRED.to_owned()),
        Values::Linear => Some(LINEAR.to_owned()),
        Values::Depth => Some(DEPTH.to_owned()),
        Values::Named(meaning) => Some(meaning.replace(['\n', '\r'], " ")),
        Values::Unstated => None,
    }
}
