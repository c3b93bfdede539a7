use std::cell::Cell;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use indexmap::IndexMap;

use crate::container::Container;
use crate::globals::Global;
use crate::tensor::Storage;
use crate::{DType, Dict, Key, MAX_DEPTH, Tensor, TorchError, Value, shortened};

/// PyTorch's own limit.
const MAX_DIMENSIONS: usize = 64;

/// Bytes of dict keys that are hashed at most for each byte of the pickle. Each reference to a key, of two bytes or more, has it
/// hashed again, however long it is; names of tensors and of an optimiser's state are far below the limit.
const MAX_KEY_BYTES_PER_BYTE: usize = 64;

/// Index of a node in [`Graph`]: an opcode creates at most one node, and a pickle is shorter than 4 GiB.
pub(crate) type NodeId = u32;

/// The objects of a pickle. They refer to each other by index, with Python's semantics: a list can be filled after others
/// refer to it, can be shared, and can contain itself. Dropping the graph does not recurse.
pub(crate) struct Graph<'a> {
    pub(crate) nodes: Vec<Node>,
    /// The bytes that strings and bytes are ranges of.
    pub(crate) source: &'a [u8],
}

pub(crate) enum Node {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    Str(Range<u32>),
    Bytes(Range<u32>),
    List(Vec<NodeId>),
    Tuple(Box<[NodeId]>),
    Dict(Vec<(NodeId, NodeId)>),
    Global(Global),
    Storage(StorageRef),
    Tensor(Box<TensorRef>),
}

/// `('storage', class, key, location, numel)`.
#[derive(Clone, Copy)]
pub(crate) struct StorageRef {
    pub(crate) dtype: DType,
    pub(crate) key: NodeId,
    /// In elements.
    pub(crate) len: u64,
}

/// Arguments of `_rebuild_tensor` and `_rebuild_tensor_v2`. Tuples are references, because many tensors may share them.
pub(crate) struct TensorRef {
    pub(crate) storage: StorageRef,
    pub(crate) offset: u64,
    pub(crate) shape: NodeId,
    pub(crate) strides: NodeId,
}

impl Node {
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::None => "None",
            Self::Bool(_) => "a bool",
            Self::Int(_) => "an integer",
            Self::Float(_) => "a float",
            Self::Str(_) => "text",
            Self::Bytes(_) => "bytes",
            Self::List(_) => "a list",
            Self::Tuple(_) => "a tuple",
            Self::Dict(_) => "a dict",
            Self::Global(_) => "a class or function",
            Self::Storage(_) => "a storage",
            Self::Tensor(_) => "a tensor",
        }
    }
}

impl<'a> Graph<'a> {
    pub(crate) fn node(&self, id: NodeId) -> &Node {
        self.nodes.get(id as usize).unwrap_or_else(|| unreachable!("an id is the index of a node"))
    }

    pub(crate) fn text(&self, id: NodeId) -> Option<&'a str> {
        match self.node(id) {
            Node::Str(range) => Some(self.utf8(range)),
            _ => None,
        }
    }

    fn utf8(&self, range: &Range<u32>) -> &'a str {
        std::str::from_utf8(self.slice(range)).unwrap_or_else(|_| unreachable!("strings are checked when read"))
    }

    /// The key of a storage, which is always a string.
    fn key(&self, id: NodeId) -> &'a str {
        self.text(id).unwrap_or_else(|| unreachable!("the key is checked when the storage is created"))
    }

    pub(crate) fn slice(&self, range: &Range<u32>) -> &'a [u8] {
        let slice = self.source.get(range.start as usize..range.end as usize);
        slice.unwrap_or_else(|| unreachable!("ranges are inside the bytes read"))
    }

    /// Element type and count of every storage in the pickle.
    pub(crate) fn storages(&self) -> Result<HashMap<&'a str, (DType, u64)>, TorchError> {
        let mut storages = HashMap::new();
        for node in &self.nodes {
            let Node::Storage(StorageRef { dtype, key, len }) = *node else { continue };
            let key = self.key(key);
            let earlier = storages.insert(key, (dtype, len));
            if earlier.is_some_and(|earlier| earlier != (dtype, len)) {
                let location = format!("legacy storage {:?}", shortened(key));
                return Err(TorchError::malformed(location, "one type and length", "several"));
            }
        }
        Ok(storages)
    }

    /// Converts `root` to a tree, in which each object is created once and shared as in the pickle.
    ///
    /// # Errors
    /// For an object that contains itself, nesting beyond [`MAX_DEPTH`], or a tensor that does not fit its storage.
    pub(crate) fn into_value(self, root: NodeId, container: &Arc<Container>) -> Result<Value, TorchError> {
        let mut tree = Tree {
            states: (0..self.nodes.len()).map(|_| State::New).collect(),
            key_bytes_left: Cell::new(self.source.len().saturating_mul(MAX_KEY_BYTES_PER_BYTE)),
            graph: self,
            dimensions: HashMap::new(),
            container,
        };
        let mut pending = vec![root];
        while let Some(&id) = pending.last() {
            match tree.state(id) {
                State::Done(..) => {
                    pending.pop();
                }
                State::New => tree.open(id, &mut pending)?,
                State::Open => tree.close(id)?,
            }
        }
        tree.done(root).map(|(value, _)| value)
    }
}

enum State {
    New,
    /// Its parts are being created; encountering it now means that it contains itself.
    Open,
    /// Created, with its nesting depth.
    Done(Value, usize),
}

struct Tree<'a, 'c> {
    graph: Graph<'a>,
    states: Vec<State>,
    /// Bytes of dict keys that may still be hashed.
    key_bytes_left: Cell<usize>,
    /// Shapes and strides by tuple.
    dimensions: HashMap<NodeId, Arc<[u64]>>,
    container: &'c Arc<Container>,
}

impl Tree<'_, '_> {
    fn state(&self, id: NodeId) -> &State {
        self.states.get(id as usize).unwrap_or_else(|| unreachable!("every node has a state"))
    }

    fn set(&mut self, id: NodeId, state: State) {
        if let Some(slot) = self.states.get_mut(id as usize) {
            *slot = state;
        }
    }

    fn done(&self, id: NodeId) -> Result<(Value, usize), TorchError> {
        match self.state(id) {
            State::Done(value, depth) => Ok((value.clone(), *depth)),
            State::New | State::Open => Err(TorchError::malformed("pickle", "a finished object", "an unfinished one")),
        }
    }

    fn open(&mut self, id: NodeId, pending: &mut Vec<NodeId>) -> Result<(), TorchError> {
        self.set(id, State::Open);
        let before = pending.len();
        match self.graph.node(id) {
            Node::List(items) => pending.extend(items),
            Node::Tuple(items) => pending.extend(items.iter()),
            Node::Dict(entries) => pending.extend(entries.iter().flat_map(|&(key, value)| [key, value])),
            _ => {}
        }
        if pending[before..].iter().any(|&part| matches!(self.state(part), State::Open)) {
            return Err(TorchError::unsupported("pickle", "an object that contains itself"));
        }
        Ok(())
    }

    fn close(&mut self, id: NodeId) -> Result<(), TorchError> {
        let mut depth = 0;
        let value = match self.graph.node(id) {
            Node::None => Value::None,
            Node::Bool(value) => Value::Bool(*value),
            Node::Int(value) => Value::Int(*value),
            Node::Float(value) => Value::Float(*value),
            Node::Str(range) => Value::Str(self.graph.utf8(range).into()),
            Node::Bytes(range) => Value::Bytes(self.graph.slice(range).into()),
            Node::List(items) => Value::List(self.items(items, &mut depth)?),
            Node::Tuple(items) => Value::Tuple(self.items(items, &mut depth)?),
            Node::Dict(entries) => Value::Dict(Arc::new(self.dict(entries, &mut depth)?)),
            Node::Tensor(parts) => {
                let (storage, offset) = (self.storage(parts.storage)?, parts.offset);
                let (shape, strides) = (parts.shape, parts.strides);
                let (shape, strides) = (self.dimensions(shape)?, self.dimensions(strides)?);
                Value::Tensor(Arc::new(Tensor::new(storage, offset, shape, strides)?))
            }
            node @ (Node::Global(_) | Node::Storage(_)) => {
                return Err(TorchError::malformed("pickle", "data", format!("{} as a value", node.kind())));
            }
        };
        if depth > MAX_DEPTH {
            return Err(TorchError::unsupported("pickle", format!("nesting deeper than {MAX_DEPTH}")));
        }
        self.set(id, State::Done(value, depth));
        Ok(())
    }

    fn items(&self, items: &[NodeId], depth: &mut usize) -> Result<Arc<[Value]>, TorchError> {
        items.iter().map(|&item| self.part(item, depth)).collect()
    }

    fn dict(&self, entries: &[(NodeId, NodeId)], depth: &mut usize) -> Result<Dict, TorchError> {
        let mut dict = IndexMap::with_capacity(entries.len());
        for &(key, value) in entries {
            let key = match self.part(key, depth)? {
                Value::Str(text) => {
                    self.take_key_bytes(&text)?;
                    Key::Str(text)
                }
                Value::Int(number) => Key::Int(number),
                other => return Err(TorchError::malformed("dict key", "text or an integer", other.to_string())),
            };
            dict.insert(key, self.part(value, depth)?);
        }
        Ok(Dict { entries: dict })
    }

    /// An error for the key that exceeds what all keys together may have hashed.
    fn take_key_bytes(&self, key: &str) -> Result<(), TorchError> {
        let left = self.key_bytes_left.get().checked_sub(key.len()).ok_or_else(|| {
            let expected = format!("keys of together at most {MAX_KEY_BYTES_PER_BYTE} times the pickle's size");
            TorchError::malformed("dict keys", expected, format!("{:?} used repeatedly", shortened(key)))
        })?;
        self.key_bytes_left.set(left);
        Ok(())
    }

    fn part(&self, id: NodeId, depth: &mut usize) -> Result<Value, TorchError> {
        let (value, below) = self.done(id)?;
        *depth = (*depth).max(below + 1);
        Ok(value)
    }

    fn storage(&self, reference: StorageRef) -> Result<Storage, TorchError> {
        let StorageRef { dtype, key, len } = reference;
        let key = self.graph.key(key);
        let location = || format!("storage {:?}", shortened(key));
        let found = self.container.len(key);
        let found = found.ok_or_else(|| TorchError::malformed(location(), "its bytes in the file", "none"))?;
        if len.checked_mul(dtype.bytes() as u64) != Some(found) {
            let expected = format!("{len} elements of {dtype}");
            return Err(TorchError::malformed(location(), expected, format!("{found} bytes")));
        }
        Ok(Storage { container: Arc::clone(self.container), key: key.into(), dtype, len })
    }

    fn dimensions(&mut self, id: NodeId) -> Result<Arc<[u64]>, TorchError> {
        if let Some(dimensions) = self.dimensions.get(&id) {
            return Ok(Arc::clone(dimensions));
        }
        let expected = || format!("a tuple of at most {MAX_DIMENSIONS} counts");
        let items = match self.graph.node(id) {
            Node::Tuple(items) if items.len() <= MAX_DIMENSIONS => items,
            Node::Tuple(items) => {
                return Err(TorchError::malformed("tensor shape", expected(), items.len().to_string()));
            }
            other => return Err(TorchError::malformed("tensor shape", expected(), other.kind())),
        };
        let count = |&item: &NodeId| match self.graph.node(item) {
            Node::Int(value) => u64::try_from(*value)
                .map_err(|source| TorchError::malformed("tensor shape", "counts", format!("{value} ({source})"))),
            other => Err(TorchError::malformed("tensor shape", "counts", other.kind())),
        };
        let dimensions: Arc<[u64]> = items.iter().map(count).collect::<Result<_, _>>()?;
        self.dimensions.insert(id, Arc::clone(&dimensions));
        Ok(dimensions)
    }
}
