use super::*;
use atsplat_numeric::Tolerance;

fn counted(shape: &[usize]) -> StoredTensor {
    let values: Vec<f32> = (0u16..).map(f32::from).take(shape.iter().product()).collect();
    StoredTensor::from_f32(shape.to_vec(), &values).unwrap()
}

fn assert_values(tensor: &StoredTensor, expected: &[f64]) {
    Tolerance::EXACT.assert(tensor.to_f32().unwrap().into_iter().map(f64::from), expected.iter().copied(), "values");
}

#[test]
fn tensors_are_transposed_split_and_joined() {
    assert_values(&counted(&[2, 3]).transposed().unwrap(), &[0.0, 3.0, 1.0, 4.0, 2.0, 5.0]);
    assert!(counted(&[6]).transposed().is_err());
    let whole = counted(&[4, 2]);
    let (first, second) = (whole.part(0, 2).unwrap(), whole.part(1, 2).unwrap());
    assert_eq!(second.shape(), [2, 2]);
    assert_values(&second, &[4.0, 5.0, 6.0, 7.0]);
    assert_eq!(StoredTensor::joined(&[&first, &second]).unwrap().bytes(), whole.bytes());
    for (part, count) in [(0, 3), (2, 2), (0, 0)] {
        assert!(whole.part(part, count).is_err(), "{part} of {count}");
    }
    assert!(StoredTensor::from_f32(vec![], &[1.0]).unwrap().part(0, 1).is_err(), "a scalar has no parts");
    assert!(StoredTensor::joined(&[]).is_err());
    assert!(StoredTensor::joined(&[&counted(&[2, 2]), &counted(&[2, 3])]).is_err());
    assert!(StoredTensor::joined(&[&first, &second.to_f16().unwrap()]).is_err());
}

#[test]
fn tensors_without_elements_may_have_any_shape() {
    let empty = |shape: &[usize]| StoredTensor::new(DType::F32, shape.to_vec(), SharedBytes::new(vec![])).unwrap();
    assert_eq!(empty(&[0, 1 << 60]).transposed().unwrap().shape(), [1 << 60, 0]);
    assert_eq!(StoredTensor::joined(&[&empty(&[3, 0]), &empty(&[2, 0])]).unwrap().shape(), [5, 0]);
    let long = empty(&[1 << 63, 0]);
    let error = StoredTensor::joined(&[&long, &long]).unwrap_err().to_string();
    assert!(error.contains("fewer than 2⁶⁴ rows"), "{error}");
}

#[test]
fn converts_every_floating_point_type() {
    let tensor = |dtype, bytes: &[u8]| StoredTensor::new(dtype, vec![1], SharedBytes::new(bytes.to_vec()));
    assert_values(&tensor(DType::F16, &[0x00, 0xc0]).unwrap(), &[-2.0]);
    assert_values(&tensor(DType::Bf16, &[0x20, 0xc1]).unwrap(), &[-10.0]);
    assert_values(&tensor(DType::F64, &0.5f64.to_le_bytes()).unwrap(), &[0.5]);
    assert!(tensor(DType::I64, &[0; 8]).unwrap().to_f32().is_err());
    assert!(tensor(DType::F32, &[0; 5]).is_err(), "five bytes are not an f32");
    assert!(StoredTensor::new(DType::U8, vec![usize::MAX, 2], SharedBytes::new(vec![])).is_err());
    assert!(StoredTensor::from_f32(vec![1], &[1e6]).unwrap().to_f16().is_err(), "beyond the range of f16");
    assert_values(&StoredTensor::from_f32(vec![1], &[65504.0]).unwrap().to_f16().unwrap(), &[65504.0]);
    // 257 and 259 lie half-way between values with eight significant bits and round to even.
    let brain = StoredTensor::from_f32(vec![3], &[257.0, 259.0, -1e30]).unwrap().to_bf16().unwrap();
    assert_values(&brain, &[256.0, 260.0, f64::from(bf16::from_f32(-1e30).to_f32())]);
    assert!(StoredTensor::from_f32(vec![1], &[f32::MAX]).unwrap().to_bf16().is_err(), "rounds to infinity");
    let wide = |value: f64| tensor(DType::F64, &value.to_le_bytes()).unwrap();
    for halves in [StoredTensor::to_f16, StoredTensor::to_bf16] {
        let error = halves(&wide(1e300)).unwrap_err().to_string();
        assert!(error.contains("found 1e300") && error.contains("can represent"), "{error}");
        assert_values(&halves(&wide(-0.75)).unwrap(), &[-0.75]);
        assert_values(&halves(&wide(f64::NEG_INFINITY)).unwrap(), &[f64::NEG_INFINITY]);
    }
}
