use crate::DType;

/// The Python objects that a pickle may refer to. None of them runs code chosen by the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Global {
    /// `collections.OrderedDict`.
    OrderedDict,
    /// `torch._utils._rebuild_tensor_v2`, and `_rebuild_tensor` of PyTorch before 0.4.
    RebuildTensor,
    /// `torch._utils._rebuild_parameter`.
    RebuildParameter,
    /// A storage class, represented by its element type.
    Storage(DType),
}

impl Global {
    /// The allow-list. It deliberately omits `torch.storage._load_from_bytes`, which would unpickle again.
    pub(crate) fn allowed(module: &str, name: &str) -> Option<Self> {
        Some(match (module, name) {
            ("collections", "OrderedDict") => Self::OrderedDict,
            ("torch._utils", "_rebuild_tensor_v2" | "_rebuild_tensor") => Self::RebuildTensor,
            ("torch._utils", "_rebuild_parameter") => Self::RebuildParameter,
            ("torch.storage", "UntypedStorage") | ("torch", "ByteStorage") => Self::Storage(DType::U8),
            ("torch", "CharStorage") => Self::Storage(DType::I8),
            ("torch", "ShortStorage") => Self::Storage(DType::I16),
            ("torch", "IntStorage") => Self::Storage(DType::I32),
            ("torch", "LongStorage") => Self::Storage(DType::I64),
            ("torch", "HalfStorage") => Self::Storage(DType::F16),
            ("torch", "BFloat16Storage") => Self::Storage(DType::Bf16),
            ("torch", "FloatStorage") => Self::Storage(DType::F32),
            ("torch", "DoubleStorage") => Self::Storage(DType::F64),
            ("torch", "BoolStorage") => Self::Storage(DType::Bool),
            _ => return None,
        })
    }
}
