use atsplat_tests::on_threads;
use burn::Tensor;
use burn::tensor::{Device, Int, TensorData};
use proptest::prelude::*;

use super::{bits, random};
use crate::layers::{AttentionConfig, Block, BlockConfig};
use crate::{MatmulPrecision, NormKind, ops};

fn block(width: usize, heads: usize, device: &Device) -> Block {
    device.seed(7);
    let attention = AttentionConfig::new(width, heads).with_qk_norm(Some(NormKind::Rms));
    BlockConfig::new(attention, 4 * width).with_layer_scale(Some(0.5)).init(device)
}

/// The output and every gradient of a block, as bits.
fn trained(block: &Block, x: &Tensor<3>) -> Vec<Vec<u32>> {
    let x = x.clone().require_grad();
    let out = block.forward(x.clone());
    let gradients = (out.clone() * out.clone()).sum().backward();
    let matrix = |weight: &burn::module::Param<Tensor<2>>| bits(weight.val().grad(&gradients).unwrap());
    let vector = |weight: &burn::module::Param<Tensor<1>>| bits(weight.val().grad(&gradients).unwrap());
    vec![
        bits(out),
        bits(x.grad(&gradients).unwrap()),
        matrix(&block.attn.qkv.weight),
        matrix(&block.mlp.fc1.weight),
        matrix(&block.mlp.fc2.weight),
        vector(block.mlp.fc1.bias.as_ref().unwrap()),
        vector(&block.norm1.gamma),
        vector(block.norm2.beta.as_ref().unwrap()),
        vector(&block.attn.q_norm.as_ref().unwrap().gamma),
    ]
}

#[test]
fn threads_do_not_change_bits() {
    let device = Device::flex().autodiff();
    let block = block(48, 3, &device);
    let x = Tensor::from_inner(random([3, 130, 48], 5));
    for precision in [MatmulPrecision::F32, MatmulPrecision::Bf16] {
        let run = || precision.scope(|| trained(&block, &x));
        let alone = on_threads(1, run);
        for threads in [2, 3, 7] {
            assert_eq!(alone, on_threads(threads, run), "{precision:?}, {threads} threads");
        }
    }
}

/// The output and every gradient move, and by no more than rounding of inputs to 8 bits explains.
#[test]
fn products_of_bfloat16_are_used_in_both_passes_until_their_scope_ends() {
    let device = Device::flex().autodiff();
    let block = block(48, 3, &device);
    let x = Tensor::from_inner(random([2, 130, 48], 5));
    let exact = trained(&block, &x);
    let rounded = MatmulPrecision::Bf16.scope(|| trained(&block, &x));
    for (part, (exact, rounded)) in exact.iter().zip(&rounded).enumerate() {
        let [exact, rounded] = [exact, rounded].map(|bits| bits.iter().map(|&bits| f64::from(f32::from_bits(bits))));
        let squares: f64 = exact.clone().map(|value| value * value).sum();
        let moved: f64 = exact.zip(rounded).map(|(a, b)| (a - b).powi(2)).sum();
        let relative = (moved / squares).sqrt();
        assert!((1e-5..2e-2).contains(&relative), "part {part} moved by {relative}");
    }
    let panicked = std::panic::catch_unwind(|| MatmulPrecision::Bf16.scope(|| panic!("inside a scope")));
    assert!(panicked.is_err());
    assert_eq!(exact, trained(&block, &x), "outside of the scope");
}

/// Whichever precision is current when they are computed.
#[test]
fn gradients_have_the_precision_of_the_forward_pass() {
    use MatmulPrecision::{Bf16, F32};
    let device = Device::flex().autodiff();
    let block = block(48, 3, &device);
    let x = Tensor::<3>::from_inner(random([2, 40, 48], 5));
    let differentiated = |forward: MatmulPrecision, backward: MatmulPrecision| {
        let x = x.clone().require_grad();
        let out = forward.scope(|| block.forward(x.clone()));
        let gradients = backward.scope(|| (out.clone() * out).sum().backward());
        [bits(x.grad(&gradients).unwrap()), bits(block.attn.qkv.weight.val().grad(&gradients).unwrap())]
    };
    let (exact, rounded) = (differentiated(F32, F32), differentiated(Bf16, Bf16));
    assert_ne!(exact, rounded);
    assert_eq!(differentiated(F32, Bf16), exact, "exact, then rounded");
    assert_eq!(differentiated(Bf16, F32), rounded, "rounded, then exact");
}

#[test]
fn a_sample_does_not_depend_on_its_batch() {
    let device = Device::flex();
    let block = block(48, 3, &device);
    for tokens in [1, 2, 17, 130] {
        let x = random::<3>([5, tokens, 48], 11);
        let together = bits(block.forward(x.clone()));
        for sample in 0..5 {
            let alone = bits(block.forward(x.clone().narrow(0, sample, 1)));
            assert_eq!(
                alone,
                together[sample * tokens * 48..(sample + 1) * tokens * 48],
                "sample {sample} of {tokens}"
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn rows_of_a_linear_layer_are_independent(
        rows in 1usize..40, inputs in 1usize..700, outputs in 1usize..40, first in 0usize..40, seed in 0u64..1000
    ) {
        let first = first % rows;
        let (x, weight) = (random::<2>([rows, inputs], seed), random::<2>([inputs, outputs], seed + 1));
        let bias = random::<1>([outputs], seed + 2);
        let all = bits(ops::linear(x.clone(), weight.clone(), Some(bias.clone())));
        let some = bits(ops::linear(x.narrow(0, first, rows - first), weight, Some(bias)));
        prop_assert_eq!(&all[first * outputs..], &some[..]);
    }

    #[test]
    fn queries_are_independent(
        queries in 1usize..150, keys in 1usize..300, heads in 1usize..4, head_width in 1usize..20, first in 0usize..150
    ) {
        let (width, first) = (heads * head_width, first % queries);
        let (q, kv) = (random::<3>([1, queries, width], 1), random::<3>([1, keys, 2 * width], 2));
        let all = bits(ops::cross_attention(q.clone(), kv.clone(), heads));
        let some = bits(ops::cross_attention(q.slice([0..1, first..queries]), kv, heads));
        prop_assert_eq!(&all[first * width..], &some[..]);
    }

    #[test]
    fn elements_do_not_depend_on_their_position(count in 1usize..70, first in 0usize..70) {
        let first = first % count;
        let x = random::<1>([count], 3) * 5.0;
        prop_assert_eq!(&bits(ops::gelu(x.clone()))[first..], &bits(ops::gelu(x.narrow(0, first, count - first)))[..]);
    }
}

#[test]
fn gradients_of_gathered_rows_do_not_depend_on_threads() {
    let rows: Vec<i64> = (0..4 * 300).map(|pick| pick * 7 % 11).collect();
    let device = Device::flex().autodiff();
    let numbers = Tensor::<3, Int>::from_data(TensorData::new(rows, [4, 100, 3]), &device);
    let gradient = |threads| {
        let x = Tensor::<3>::from_inner(random([4, 11, 9], 1)).require_grad();
        on_threads(threads, || {
            let out = ops::gather_max(x.clone(), numbers.clone());
            let gathered = ops::gather_rows(x.clone(), numbers.clone().reshape([4, 300]));
            bits(x.grad(&((out.clone() * out).sum() + gathered.exp().sum()).backward()).unwrap())
        })
    };
    assert_eq!(gradient(1), gradient(3));
}
