//! Times transformer blocks on request, so that a script can alternate with another library in one run.
//!
//! Each line on standard input names a case; the answer is one line with its time in milliseconds.

use std::collections::BTreeMap;
use std::io::{BufRead, Write, stdin, stdout};
use std::time::Instant;

use atsplat_nn::layers::{AttentionConfig, Block, BlockConfig};
use burn::Tensor;
use burn::module::Module;
use burn::tensor::{Device, Distribution};

fn main() -> std::io::Result<()> {
    let device = Device::flex();
    let mut cases: BTreeMap<&str, Box<dyn FnMut()>> = BTreeMap::new();

    let wide = block(768, 12, &device).no_grad();
    let tokens = Tensor::<3>::random([1, 514, 768], Distribution::Normal(0.0, 1.0), &device);
    cases.insert("forward-768", Box::new(move || drop(wide.forward(tokens.clone()))));

    let tracked = device.clone().autodiff();
    let narrow = block(192, 6, &tracked);
    let tokens = Tensor::<3>::random([8, 256, 192], Distribution::Normal(0.0, 1.0), &tracked);
    cases.insert(
        "training-192",
        Box::new(move || {
            let out = narrow.forward(tokens.clone());
            let gradients = (out.clone() * out).mean().backward();
            drop(narrow.mlp.fc1.weight.val().grad(&gradients));
        }),
    );

    for line in stdin().lock().lines() {
        let line = line?;
        let Some(case) = cases.get_mut(line.trim()) else { continue };
        let start = Instant::now();
        case();
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        writeln!(stdout(), "{milliseconds}")?;
        stdout().flush()?;
    }
    Ok(())
}

fn block(width: usize, heads: usize, device: &Device) -> Block {
    BlockConfig::new(AttentionConfig::new(width, heads), 4 * width).init(device)
}
