use super::{ChunkScene, TorchError};
use crate::SharedBytes;

/// Writes the pickle of a chunk in protocol 2, and collects the storages that it refers to.
///
/// Nothing is memoised: a few repeated names per image are negligible.
pub(super) struct PickleWriter {
    bytes: Vec<u8>,
    storages: Vec<SharedBytes>,
}

impl PickleWriter {
    /// The pickle of a list of scenes, and their storages in the order of their keys `0`, `1`, ….
    pub(super) fn chunk(scenes: &[ChunkScene]) -> Result<(Vec<u8>, Vec<SharedBytes>), TorchError> {
        let mut writer = Self { bytes: b"\x80\x02](".to_vec(), storages: Vec::new() };
        for scene in scenes {
            writer.scene(scene)?;
        }
        writer.bytes.extend_from_slice(b"e.");
        Ok((writer.bytes, writer.storages))
    }

    fn scene(&mut self, scene: &ChunkScene) -> Result<(), TorchError> {
        self.bytes.extend_from_slice(b"}(");
        self.text("url")?;
        self.text(&scene.url)?;
        self.text("timestamps")?;
        let timestamps: Vec<u8> = scene.timestamps.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.tensor("LongStorage", SharedBytes::new(timestamps), &[scene.timestamps.len()])?;
        self.text("cameras")?;
        self.tensor("FloatStorage", camera_bytes(scene)?, &[scene.cameras.len(), 18])?;
        self.text("images")?;
        self.bytes.extend_from_slice(b"](");
        for image in &scene.images {
            self.tensor("ByteStorage", image.clone(), &[image.len()])?;
        }
        self.bytes.push(b'e');
        self.text("key")?;
        self.text(&scene.key)?;
        self.bytes.push(b'u');
        Ok(())
    }

    /// `_rebuild_tensor_v2(storage, 0, shape, strides, False, OrderedDict())`, row-major.
    fn tensor(&mut self, class: &str, data: SharedBytes, shape: &[usize]) -> Result<(), TorchError> {
        self.global("torch._utils", "_rebuild_tensor_v2");
        self.bytes.extend_from_slice(b"((");
        self.text("storage")?;
        self.global("torch", class);
        self.text(&self.storages.len().to_string())?;
        self.text("cpu")?;
        self.integer(shape.iter().product());
        self.bytes.extend_from_slice(b"tQ");
        self.integer(0);
        self.tuple(shape);
        // As in NumPy and PyTorch, empty dimensions count as one in strides.
        let strides: Vec<usize> =
            (1..=shape.len()).map(|from| shape.iter().skip(from).map(|&size| size.max(1)).product()).collect();
        self.tuple(&strides);
        self.bytes.push(0x89);
        self.global("collections", "OrderedDict");
        self.bytes.extend_from_slice(b")RtR");
        self.storages.push(data);
        Ok(())
    }

    fn tuple(&mut self, numbers: &[usize]) {
        self.bytes.push(b'(');
        for &number in numbers {
            self.integer(number);
        }
        self.bytes.push(b't');
    }

    fn integer(&mut self, value: usize) {
        if let Ok(small) = u8::try_from(value) {
            self.bytes.extend_from_slice(&[b'K', small]);
        } else if let Ok(middle) = i32::try_from(value) {
            self.bytes.push(b'J');
            self.bytes.extend_from_slice(&middle.to_le_bytes());
        } else {
            self.bytes.extend_from_slice(b"\x8a\x08");
            self.bytes.extend_from_slice(&(value as u64).to_le_bytes());
        }
    }

    fn text(&mut self, text: &str) -> Result<(), TorchError> {
        let len = u32::try_from(text.len())
            .map_err(|source| TorchError::unsupported("chunk", format!("text of {} bytes ({source})", text.len())))?;
        self.bytes.push(b'X');
        self.bytes.extend_from_slice(&len.to_le_bytes());
        self.bytes.extend_from_slice(text.as_bytes());
        Ok(())
    }

    fn global(&mut self, module: &str, name: &str) {
        self.bytes.extend_from_slice(format!("c{module}\n{name}\n").as_bytes());
    }
}

fn camera_bytes(scene: &ChunkScene) -> Result<SharedBytes, TorchError> {
    let mut bytes = Vec::with_capacity(scene.cameras.len() * 18 * size_of::<f32>());
    for (position, value) in scene.cameras.iter().enumerate().flat_map(|(at, row)| row.iter().map(move |v| (at, *v))) {
        #[expect(clippy::cast_possible_truncation, reason = "chunks store f32")]
        let narrow = value as f32;
        if !narrow.is_finite() {
            let location = format!("scene {:?}, field cameras[{position}]", scene.key);
            return Err(TorchError::malformed(location, "finite f32 numbers", value.to_string()));
        }
        bytes.extend_from_slice(&narrow.to_le_bytes());
    }
    Ok(SharedBytes::new(bytes))
}
