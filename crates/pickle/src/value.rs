use std::fmt;
use std::sync::Arc;

use indexmap::IndexMap;

use crate::Tensor;

/// A Python object of a `torch.save` file.
///
/// Objects shared in the pickle are shared here too, so a malicious file cannot make the tree larger than itself. A
/// traversal of every path may still visit an object many times and must bound its own work. Nesting is at most
/// [`crate::MAX_DEPTH`] deep and never cyclic.
#[derive(Clone)]
pub enum Value {
    /// `None`.
    None,
    /// `True` or `False`.
    Bool(bool),
    /// An integer of at most 64 bits.
    Int(i64),
    /// A float.
    Float(f64),
    /// A string.
    Str(Arc<str>),
    /// Raw bytes.
    Bytes(Arc<[u8]>),
    /// A list.
    List(Arc<[Value]>),
    /// A tuple.
    Tuple(Arc<[Value]>),
    /// A `dict` or `OrderedDict`.
    Dict(Arc<Dict>),
    /// A tensor, or a `torch.nn.Parameter` without its gradient flag.
    Tensor(Arc<Tensor>),
}

/// A key of a [`Dict`]; Python dicts with other keys are errors.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Key {
    /// A string.
    Str(Arc<str>),
    /// An integer, as in optimiser states.
    Int(i64),
}

/// A Python dict in insertion order; a repeated key keeps its first position and its last value, as in Python.
#[derive(Clone, Default)]
pub struct Dict {
    pub(crate) entries: IndexMap<Key, Value>,
}

impl Dict {
    /// The value of a string key.
    pub fn get(&self, key: &str) -> Option<&Value> {
        self.entries.get(&Key::Str(key.into()))
    }

    /// All entries in insertion order.
    pub fn iter(&self) -> impl Iterator<Item = (&Key, &Value)> {
        self.entries.iter()
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there are no entries.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }
}

impl Value {
    /// The string of a [`Value::Str`].
    pub fn as_str(&self) -> Option<&str> {
        match self {
            Self::Str(text) => Some(text),
            _ => None,
        }
    }

    /// The elements of a [`Value::List`] or [`Value::Tuple`].
    pub fn as_sequence(&self) -> Option<&[Self]> {
        match self {
            Self::List(items) | Self::Tuple(items) => Some(items),
            _ => None,
        }
    }

    /// The entries of a [`Value::Dict`].
    pub fn as_dict(&self) -> Option<&Dict> {
        match self {
            Self::Dict(dict) => Some(dict),
            _ => None,
        }
    }

    /// The tensor of a [`Value::Tensor`].
    pub fn as_tensor(&self) -> Option<&Tensor> {
        match self {
            Self::Tensor(tensor) => Some(tensor),
            _ => None,
        }
    }
}

/// Formats one level only: the output for shared parts a hundred levels deep would be unbounded.
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("None"),
            Self::Bool(value) => write!(f, "{value}"),
            Self::Int(value) => write!(f, "the integer {value}"),
            Self::Float(value) => write!(f, "the float {value}"),
            Self::Str(text) => write!(f, "the text {:?}", crate::shortened(text)),
            Self::Bytes(bytes) => write!(f, "{} bytes", bytes.len()),
            Self::List(items) => write!(f, "a list of {}", items.len()),
            Self::Tuple(items) => write!(f, "a tuple of {}", items.len()),
            Self::Dict(dict) => write!(f, "a dict of {}", dict.len()),
            Self::Tensor(tensor) => write!(f, "{tensor}"),
        }
    }
}

impl fmt::Debug for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl fmt::Debug for Dict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_map().entries(self.iter()).finish()
    }
}
