//! Reading device memory.

use std::sync::PoisonError;
use std::time::Duration;

use super::GpuError;
use super::context::Context;

/// Limit on the bytes of the staging buffer.
const STAGING_LIMIT: u64 = 64 << 20;
/// Timeout for mapping once the device is done.
const MAP_TIMEOUT: Duration = Duration::from_mins(1);

/// A byte range of one of the buffers to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Piece {
    buffer: usize,
    from: u64,
    bytes: u64,
}

/// A reading whose first load is copied by commands that are not submitted yet.
pub(super) struct Reading {
    /// Bytes of each source.
    lengths: Vec<u64>,
    sources: Vec<wgpu::Buffer>,
    loads: Vec<Vec<Piece>>,
    staging: Option<wgpu::Buffer>,
}

impl Reading {
    /// Records copies of the first bytes (whole words) of buffers. Their total may exceed the largest buffer: what
    /// exceeds the staging buffer is copied by [`Self::finish`].
    pub(super) fn begin(
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        sources: &[(&wgpu::Buffer, u64)],
    ) -> Self {
        let lengths: Vec<u64> = sources.iter().map(|(_, bytes)| *bytes).collect();
        let loads = loads(&lengths, context.binding_limit.clamp(256, STAGING_LIMIT));
        let largest = loads.iter().map(|load| load.iter().map(|piece| piece.bytes).sum()).max();
        let staging = largest.map(|bytes| context.take_staging(bytes));
        let sources = sources.iter().map(|(buffer, _)| (*buffer).clone()).collect();
        let reading = Self { lengths, sources, loads, staging };
        reading.copy(encoder, reading.loads.first());
        reading
    }

    fn copy(&self, encoder: &mut wgpu::CommandEncoder, load: Option<&Vec<Piece>>) {
        let (Some(load), Some(staging)) = (load, &self.staging) else { return };
        let mut at = 0;
        for Piece { buffer, from, bytes } in load {
            encoder.copy_buffer_to_buffer(&self.sources[*buffer], *from, staging, at, *bytes);
            at += bytes;
        }
    }

    /// Waits for the submitted copies, and returns the contents of each buffer.
    pub(super) fn finish(self, context: &Context) -> Result<Vec<Vec<u8>>, GpuError> {
        let capacity = |bytes: &u64| usize::try_from(*bytes).unwrap_or(0);
        let mut contents: Vec<Vec<u8>> = self.lengths.iter().map(|bytes| Vec::with_capacity(capacity(bytes))).collect();
        let Some(staging) = &self.staging else { return Ok(contents) };
        for (at, load) in self.loads.iter().enumerate() {
            if at > 0 {
                let mut encoder = context.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                self.copy(&mut encoder, Some(load));
                context.submit(encoder);
            }
            context.read_load(load, staging, &mut contents)?;
        }
        context.keep_staging(staging.clone());
        Ok(contents)
    }
}

impl Context {
    /// Waits for the device and reads the first bytes of buffers.
    pub(super) fn read(&self, sources: &[(&wgpu::Buffer, u64)]) -> Result<Vec<Vec<u8>>, GpuError> {
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let reading = Reading::begin(self, &mut encoder, sources);
        if reading.staging.is_some() {
            self.submit(encoder);
        }
        reading.finish(self)
    }

    fn read_load(&self, load: &[Piece], staging: &wgpu::Buffer, contents: &mut [Vec<u8>]) -> Result<(), GpuError> {
        let failed = |reason: String| GpuError::Device { adapter: self.name.clone(), reason };
        let total = load.iter().map(|piece| piece.bytes).sum();
        let (sender, receiver) = std::sync::mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, ..total, move |outcome| {
            // The receiver is gone if waiting failed.
            sender.send(outcome).ok();
        });
        self.wait()?;
        // Another thread waiting for the same device may run the callback.
        let outcome =
            receiver.recv_timeout(MAP_TIMEOUT).map_err(|error| failed(format!("no reply to mapping: {error}")))?;
        outcome.map_err(|error| failed(error.to_string()))?;
        {
            let view = staging.get_mapped_range(..total).map_err(|error| failed(error.to_string()))?;
            let mut rest: &[u8] = &view;
            for Piece { buffer, bytes, .. } in load {
                let length = usize::try_from(*bytes).map_err(|error| failed(error.to_string()))?;
                let (piece, after) = rest.split_at(length);
                contents[*buffer].extend_from_slice(piece);
                rest = after;
            }
        }
        staging.unmap();
        self.counters.bytes_down.add(total);
        Ok(())
    }

    /// A staging buffer of at least this many bytes: the last one, if it is large enough.
    fn take_staging(&self, bytes: u64) -> wgpu::Buffer {
        let kept = self.staging.lock().unwrap_or_else(PoisonError::into_inner).take();
        kept.filter(|kept| kept.size() >= bytes).unwrap_or_else(|| {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("staging"),
                size: bytes,
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        })
    }

    pub(super) fn free_staging(&self) {
        self.staging.lock().unwrap_or_else(PoisonError::into_inner).take();
    }

    fn keep_staging(&self, staging: wgpu::Buffer) {
        *self.staging.lock().unwrap_or_else(PoisonError::into_inner) = Some(staging);
    }
}

/// Splits buffers of these lengths into consecutive loads of at most `most` bytes.
fn loads(lengths: &[u64], most: u64) -> Vec<Vec<Piece>> {
    let (mut loads, mut load, mut room) = (Vec::new(), Vec::new(), most);
    for (buffer, length) in lengths.iter().enumerate() {
        let mut from = 0;
        while from < *length {
            let bytes = room.min(length - from);
            load.push(Piece { buffer, from, bytes });
            (from, room) = (from + bytes, room - bytes);
            if room == 0 {
                loads.push(std::mem::take(&mut load));
                room = most;
            }
        }
    }
    if !load.is_empty() {
        loads.push(load);
    }
    loads
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loads_are_full_and_complete() {
        let piece = |buffer, from, bytes| Piece { buffer, from, bytes };
        assert_eq!(loads(&[], 256), Vec::<Vec<Piece>>::new());
        assert_eq!(loads(&[0, 0], 256), Vec::<Vec<Piece>>::new());
        assert_eq!(loads(&[256], 256), [[piece(0, 0, 256)]]);
        let cut = [
            vec![piece(0, 0, 100), piece(2, 0, 156)],
            vec![piece(2, 156, 256)],
            vec![piece(2, 412, 88), piece(3, 0, 4)],
        ];
        assert_eq!(loads(&[100, 0, 500, 4], 256), cut);
    }
}
