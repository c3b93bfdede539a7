//! Films of a path, methods side by side.

use atsplat_pixels::{AnimatedPng, ImageU8, PixelError, encode_jpeg};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::escaped;
use crate::ReportError;

/// Quality of a film's images in the page.
const QUALITY: u8 = 90;
/// Frames per second.
const SPEED: u16 = 8;

/// Frames along a path, each seen by several methods; all images have one size.
#[derive(Clone, Debug)]
pub struct Film {
    /// Name of its file.
    pub name: String,
    /// What the columns show, from left to right.
    pub columns: Vec<String>,
    /// The path.
    pub note: String,
    /// Frame by frame, an image for each column.
    pub frames: Vec<Vec<ImageU8>>,
}

impl Film {
    /// The film as an animated PNG, lossless.
    ///
    /// # Errors
    /// [`ReportError::Image`] without frames, and for images of different sizes.
    pub fn animated_png(&self) -> Result<Vec<u8>, ReportError> {
        let frames = self.frames.iter().map(|images| side_by_side(images)).collect::<Result<Vec<_>, _>>()?;
        let size = frames.first().map_or((0, 0), |first| (first.width(), first.height()));
        let mut file = Vec::new();
        let mut animation = AnimatedPng::new(&mut file, size, u32::try_from(frames.len()).unwrap_or(u32::MAX), SPEED)?;
        frames.iter().try_for_each(|frame| animation.push(frame))?;
        animation.finish()?;
        Ok(file)
    }

    /// A player, with all frames below one another in one image.
    pub(super) fn player(&self) -> Result<String, ReportError> {
        let rows = self.frames.iter().map(|images| side_by_side(images)).collect::<Result<Vec<_>, _>>()?;
        let Some(first) = rows.first() else { return Ok(String::new()) };
        let (width, height) = (first.width(), first.height());
        let samples: Vec<u8> = rows.iter().flat_map(ImageU8::samples).copied().collect();
        let sheet = ImageU8::new(width, height * u32::try_from(rows.len()).unwrap_or(u32::MAX), samples)?;
        let heads: String = self.columns.iter().map(|column| format!("<span>{}</span>", escaped(column))).collect();
        Ok(format!(
            "<figure class=\"film\" data-speed=\"{SPEED}\"><div class=\"heads\">{heads}</div>\
             <canvas width=\"{width}\" height=\"{height}\" role=\"img\" aria-label=\"{0}\"></canvas>\
             <div class=\"choose\"><button type=\"button\">Play</button>\
             <input type=\"range\" min=\"0\" max=\"{1}\" value=\"0\" step=\"1\" aria-label=\"Frame\"></div>\
             <img hidden alt=\"\" src=\"data:image/jpeg;base64,{2}\"><figcaption>{0}; JPEG of quality {QUALITY}, lossless in \
             films/{3}.png</figcaption></figure>\n",
            escaped(&self.note),
            rows.len() - 1,
            STANDARD.encode(encode_jpeg(&sheet, QUALITY)?),
            escaped(&self.name),
        ))
    }
}

/// Images of one height from left to right.
fn side_by_side(images: &[ImageU8]) -> Result<ImageU8, PixelError> {
    let height = images.first().map_or(0, ImageU8::height);
    let row = |image: &ImageU8, row: usize| {
        let bytes = image.width() as usize * 3;
        image.samples().get(row * bytes..(row + 1) * bytes).unwrap_or_default().to_vec()
    };
    let samples = (0..height as usize).flat_map(|at| images.iter().flat_map(move |image| row(image, at)));
    ImageU8::new(images.iter().map(ImageU8::width).sum(), height, samples.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn striped(width: u32, value: u8) -> ImageU8 {
        let samples = (0..width * 2).flat_map(|at| [value, u8::try_from(at).unwrap(), 0]);
        ImageU8::new(width, 2, samples.collect()).unwrap()
    }

    #[test]
    fn images_are_side_by_side_row_by_row() {
        let joined = side_by_side(&[striped(2, 7), striped(1, 9)]).unwrap();
        assert_eq!((joined.width(), joined.height()), (3, 2));
        assert_eq!(
            [joined.pixel(0, 1), joined.pixel(1, 0), joined.pixel(2, 1)],
            [Some([7, 2, 0]), Some([7, 1, 0]), Some([9, 1, 0])]
        );
        let uneven = [striped(2, 7), ImageU8::new(1, 1, vec![0; 3]).unwrap()];
        assert!(side_by_side(&uneven).is_err());
    }

    #[test]
    fn a_film_is_an_animation_and_a_player() {
        let frames = (0..5).map(|at| vec![striped(8, 40 * at), striped(8, 200)]).collect();
        let film = Film {
            name: "f".to_owned(),
            columns: vec!["a<b".to_owned(), "c".to_owned()],
            note: "path".to_owned(),
            frames,
        };
        let file = film.animated_png().unwrap();
        assert_eq!(file.windows(4).filter(|bytes| bytes == b"fcTL").count(), 5);
        let player = film.player().unwrap();
        assert!(
            player.contains("max=\"4\"") && player.contains("a&lt;b") && player.contains("width=\"16\" height=\"2\"")
        );
        let none = Film { frames: Vec::new(), ..film };
        assert!(none.player().unwrap().is_empty() && none.animated_png().is_err());
    }
}
