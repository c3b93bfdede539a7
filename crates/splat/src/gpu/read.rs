//! Reading device memory.

use std::time::Duration;

use super::GpuError;
use super::context::Context;
use super::panics::catch_panics;

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

impl Context {
    /// Waits for the device and reads the first bytes (whole words) of buffers. Their total may exceed the largest
    /// buffer.
    pub(super) fn read(&self, sources: &[(&wgpu::Buffer, u64)]) -> Result<Vec<Vec<u8>>, GpuError> {
        let most = self.binding_limit.clamp(256, STAGING_LIMIT);
        let lengths: Vec<u64> = sources.iter().map(|(_, bytes)| *bytes).collect();
        let loads = loads(&lengths, most);
        let mut read: Vec<Vec<u8>> =
            lengths.iter().map(|bytes| Vec::with_capacity(usize::try_from(*bytes).unwrap_or(0))).collect();
        let Some(largest) = loads.iter().map(|load| load.iter().map(|piece| piece.bytes).sum()).max() else {
            return Ok(read);
        };
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("staging"),
            size: largest,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        for load in loads {
            self.read_load(sources, &load, &staging, &mut read)?;
        }
        Ok(read)
    }

    fn read_load(
        &self,
        sources: &[(&wgpu::Buffer, u64)],
        load: &[Piece],
        staging: &wgpu::Buffer,
        read: &mut [Vec<u8>],
    ) -> Result<(), GpuError> {
        let failed = |reason: String| GpuError::Device { adapter: self.name.clone(), reason };
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut at = 0;
        for Piece { buffer, from, bytes } in load {
            encoder.copy_buffer_to_buffer(sources[*buffer].0, *from, staging, at, *bytes);
            at += bytes;
        }
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = std::sync::mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, ..at, move |outcome| {
            // The receiver is gone if waiting failed.
            sender.send(outcome).ok();
        });
        catch_panics(&self.name, || {
            self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|error| failed(error.to_string()))
        })?;
        // Another thread waiting for the same device may run the callback.
        let outcome =
            receiver.recv_timeout(MAP_TIMEOUT).map_err(|error| failed(format!("no reply to mapping: {error}")))?;
        outcome.map_err(|error| failed(error.to_string()))?;
        {
            let view = staging.get_mapped_range(..at).map_err(|error| failed(error.to_string()))?;
            let mut rest: &[u8] = &view;
            for Piece { buffer, bytes, .. } in load {
                let length = usize::try_from(*bytes).map_err(|error| failed(error.to_string()))?;
                let (own, after) = rest.split_at(length);
                read[*buffer].extend_from_slice(own);
                rest = after;
            }
        }
        staging.unmap();
        Ok(())
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
