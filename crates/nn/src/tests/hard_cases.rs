use atsplat_numeric::Tolerance;
use burn::Tensor;
use burn::tensor::{DType, Device};

use super::{random, tensor, values};
use crate::ops;

/// The kernels' element type, and one of the generic implementation.
const BOTH: [DType; 2] = [DType::F32, DType::F64];

fn of(values: &[f64], dtype: DType) -> Tensor<1> {
    tensor(values, [values.len()], dtype, &Device::flex())
}

/// Queries of two elements that give the logits `a·x + b·y`, one head.
fn attended(queries: &[f64], keys_values: &[f64]) -> Vec<f64> {
    let device = Device::flex();
    let queries = tensor(queries, [1, queries.len() / 2, 2], DType::F32, &device);
    let keys_values = tensor(keys_values, [1, keys_values.len() / 4, 4], DType::F32, &device);
    values(ops::cross_attention(queries, keys_values, 1))
}

#[test]
fn logits_of_minus_infinity_have_no_weight() {
    let out = attended(&[1.0, 0.0], &[f64::NEG_INFINITY, 0.0, 5.0, 6.0, 1.0, 0.0, 7.0, 8.0]);
    Tolerance::EXACT.assert(out, [7.0, 8.0], "values of the other key");
}

#[test]
fn a_query_with_only_logits_of_minus_infinity_gives_zero() {
    let out = attended(&[1.0, 0.0], &[f64::NEG_INFINITY, 0.0, 5.0, 6.0]);
    Tolerance::EXACT.assert(out, [0.0, 0.0], "no key left");
}

#[test]
fn logits_that_are_not_finite_affect_only_their_query() {
    // The second query's logit with the infinite key is NaN, the first one's +∞, the third one's −∞.
    let keys_values = [f64::INFINITY, 0.0, 5.0, 6.0, 0.0, 1.0, 7.0, 8.0];
    let out = attended(&[1.0, 0.0, 0.0, 1.0, -1.0, 0.0, f64::NAN, 0.0], &keys_values);
    assert!(out[..4].iter().all(|value| value.is_nan()), "+∞ and NaN: {out:?}");
    Tolerance::EXACT.assert(out[4..6].to_vec(), [7.0, 8.0], "−∞");
    assert!(out[6..].iter().all(|value| value.is_nan()), "a NaN in the query: {out:?}");
}

#[test]
fn large_logits_do_not_overflow() {
    let out = attended(&[1e4, 0.0], &[1e4, 0.0, 5.0, 6.0, -1e4, 0.0, 7.0, 8.0]);
    Tolerance::EXACT.assert(out, [5.0, 6.0], "the larger logit's values");
}

/// One token in each of two samples. The first one's query and key are finite, but their product is not.
#[test]
fn samples_with_only_logits_of_minus_infinity_give_zero_and_no_gradient() {
    for (dtype, large) in BOTH.into_iter().zip([1e30, 1e200]) {
        let device = Device::flex().autodiff();
        let tokens = [large, 0.5, -large, 0.25, 3.0, 4.0, 0.5, 1.0, 2.0, 0.25, 5.0, 6.0];
        let packed = tensor(&tokens, [2, 1, 6], dtype, &device).require_grad();
        let out = ops::self_attention(packed.clone(), 1);
        let gradients = ((out.clone() + 1.0) * (out.clone() + 1.0)).sum().backward();
        let (out, gradient) = (values(out), values(packed.grad(&gradients).unwrap()));
        Tolerance::EXACT.assert(out[..2].to_vec(), [0.0; 2], "result");
        Tolerance::EXACT.assert(gradient[..6].to_vec(), [0.0; 6], "gradient");
        Tolerance::absolute(1e-5).assert(out[2..].to_vec(), [5.0, 6.0], "result of the other sample");
        let of_values = [0.0, 0.0, 0.0, 0.0, 12.0, 14.0];
        Tolerance::absolute(1e-4).assert(gradient[6..].to_vec(), of_values, "gradient of the other sample");
    }
}

#[test]
fn a_sample_with_nan_does_not_affect_others() {
    let x = random::<3>([3, 6, 24], 8);
    let mut broken = values(x.clone());
    broken[6 * 24 + 3] = f64::NAN;
    let broken = tensor(&broken, [3, 6, 24], DType::F32, &Device::flex());
    let (whole, partly) = (ops::self_attention(x, 2), ops::self_attention(broken, 2));
    let (whole, partly) = (super::bits(whole), super::bits(partly));
    assert_eq!(whole[..48], partly[..48]);
    assert_eq!(whole[96..], partly[96..]);
    assert!(partly[48..96].iter().any(|&bits| f32::from_bits(bits).is_nan()));
}

#[test]
fn empty_inputs_give_empty_or_zero_outputs() {
    let (none, some) = (random::<3>([2, 0, 8], 1), random::<3>([2, 3, 8], 1));
    let no_keys = ops::cross_attention(some.clone(), random([2, 0, 16], 1), 2);
    Tolerance::EXACT.assert(values(no_keys), [0.0; 48], "no keys");
    assert_eq!(ops::cross_attention(none, random([2, 3, 16], 1), 2).dims(), [2, 0, 8]);
    assert_eq!(ops::linear(random::<2>([0, 4], 1), random([4, 3], 1), None).dims(), [0, 3]);
    assert_eq!(ops::gelu(random::<2>([0, 4], 1)).dims(), [0, 4]);
    assert_eq!(ops::layer_norm(random::<2>([0, 4], 1), random([4], 1), None, 1e-5).dims(), [0, 4]);
}

#[test]
fn gelu_keeps_its_relative_error_in_the_tails() {
    // x·Φ(x), from Python's mpmath with 30 digits.
    let expected = [
        (-12.0, -2.131_778_534_493_21e-32),
        (-8.0, -4.976_768_459_417_43e-15),
        (-3.0, -0.004_049_694_094_890_28),
        (-1.0, -0.158_655_253_931_457),
        (-1e-3, -4.996_010_577_860_89e-4),
        (0.0, 0.0),
        (0.5, 0.345_731_230_637_007),
        (2.0, 1.954_499_736_103_64),
        (7.0, 6.999_999_999_991_04),
    ];
    let out = values(ops::gelu(of(&expected.map(|(x, _)| x), DType::F32)));
    Tolerance::relative(3e-6).assert(out, expected.map(|(_, y)| y), "GELU");
}

#[test]
fn gelu_of_values_that_are_not_finite() {
    for dtype in BOTH {
        let x = of(&[f64::NEG_INFINITY, f64::INFINITY, f64::NAN, 3e38, -3e38], dtype);
        let x = Tensor::from_inner(x).require_grad();
        let out = ops::gelu(x.clone());
        let gradient = values(x.grad(&out.clone().sum().backward()).unwrap());
        let out = values(out);
        Tolerance::relative(1e-6).assert([out[0], out[1], out[3], out[4]], [0.0, f64::INFINITY, 3e38, 0.0], "value");
        Tolerance::EXACT.assert([gradient[0], gradient[1], gradient[3], gradient[4]], [0.0, 1.0, 1.0, 0.0], "slope");
        assert!(out[2].is_nan() && gradient[2].is_nan(), "NaN propagates in {dtype:?}");
    }
}

#[test]
fn exponentials_are_as_accurate_as_the_standard_librarys() {
    // Two keys whose values give the weights: softmax of (0, x).
    for step in 0..400 {
        let x = -f64::from(step) * 0.2;
        let out = attended(&[2.0f64.sqrt(), 0.0], &[0.0, 0.0, 0.0, 0.0, x, 0.0, 1.0, 0.0]);
        let exact = x.exp() / (1.0 + x.exp());
        Tolerance { absolute: 1e-37, relative: 4e-7 + 2e-7 * x.abs() }.assert([out[0]], [exact], &format!("at {x}"));
    }
}

#[test]
fn constant_rows_normalise_to_beta() {
    let (gamma, beta) = (random::<1>([8], 1), random::<1>([8], 2));
    let rows = Tensor::<2>::full([3, 8], 1e4, &Device::flex());
    let out = ops::layer_norm(rows, gamma, Some(beta.clone()), 1e-5);
    Tolerance::absolute(1e-6).assert(values(out), values(beta).repeat(3), "layer norm");
}

#[test]
fn nan_is_the_maximum_and_ties_give_the_gradient_to_the_first() {
    for dtype in BOTH {
        let x = of(&[1.0, f64::NAN, 2.0, 4.0, 2.0, 5.0], dtype).reshape([1, 3, 2]);
        let x = Tensor::<3>::from_inner(x).require_grad();
        let out = ops::gather_max(x.clone(), Tensor::from_data([[[0i64, 1, 2]]], &x.device()));
        let gradient = values(x.grad(&out.clone().sum().backward()).unwrap());
        let out = values(out);
        assert!(out[1].is_nan(), "{dtype:?}");
        Tolerance::EXACT.assert([out[0]], [2.0], "value");
        Tolerance::EXACT.assert(gradient, [0.0, 1.0, 1.0, 0.0, 0.0, 0.0], "gradient");
    }
}

#[test]
#[should_panic(expected = "dtype mismatch")]
fn rejects_a_bias_of_another_type() {
    let bias = of(&[1.0, 2.0, 3.0], DType::F64);
    ops::linear(random::<2>([2, 4], 1), random([4, 3], 2), Some(bias));
}

#[test]
#[should_panic(expected = "dtype mismatch")]
fn rejects_a_beta_of_another_type() {
    let beta = of(&[1.0, 2.0, 3.0], DType::F64);
    ops::layer_norm(random::<2>([2, 3], 1), random([3], 2), Some(beta), 1e-5);
}

#[test]
#[should_panic(expected = "shape of gamma and elements of a row")]
fn rejects_a_gamma_that_is_shorter_than_a_row() {
    ops::rms_norm(random::<2>([2, 8], 1), random([4], 2), 1e-5);
}

#[test]
#[should_panic(expected = "row index 4, expected below 4")]
fn rejects_a_row_index_out_of_range() {
    let rows = Tensor::from_data([[4i64]], &Device::flex());
    ops::gather_rows(random([1, 4, 2], 1), rows);
}

#[test]
fn attention_agrees_with_burns_softmax() {
    let [q, k, v] = [1, 2, 3].map(|seed| random::<3>([2, 33, 24], seed));
    let packed = Tensor::cat(vec![q.clone(), k.clone(), v.clone()], 2);
    let ours = values(ops::self_attention(packed, 3));
    let theirs = values(super::cases::decomposed([q, k, v], 3));
    Tolerance::absolute(1e-6).assert(ours, theirs, "attention");
}

/// f64 uses the generic implementation.
#[test]
fn generic_operations_keep_shapes() {
    type Operation = fn(Tensor<3>, Tensor<1>, Tensor<2>) -> Tensor<3>;
    let device = Device::flex().autodiff();
    let numbers: Vec<f64> = (0..24).map(f64::from).collect();
    let x = || tensor(&numbers, [2, 3, 4], DType::F64, &device).require_grad();
    let ones = || tensor(&[1.0; 4], [4], DType::F64, &device);
    let weight = || tensor(&[0.5; 20], [4, 5], DType::F64, &device);
    let cases: [(Operation, usize); 4] = [
        (|x, gamma, _| ops::layer_norm(x, gamma, None, 1e-5), 4),
        (|x, gamma, _| ops::rms_norm(x, gamma, 1e-5), 4),
        (|x, _, weight| ops::linear(x, weight, None), 5),
        (|x, _, _| ops::gelu(x), 4),
    ];
    for (operation, width) in cases {
        let x = x();
        let out = operation(x.clone(), ones(), weight());
        assert_eq!(out.dims(), [2, 3, width]);
        assert_eq!(x.grad(&(out.clone() * out).sum().backward()).unwrap().dims(), [2, 3, 4]);
    }
}
