//! Objects built by calls: storages, tensors, parameters and `OrderedDict`s.

use super::Interpreter;
use crate::TorchError;
use crate::globals::Global;
use crate::graph::{Node, NodeId, StorageRef, TensorRef};

/// PyTorch numbers the storages; the legacy format uses decimal addresses.
const MAX_STORAGE_KEY_BYTES: usize = 64;

impl Interpreter<'_> {
    /// `('storage', class, key, location, numel)`; the legacy format adds a view, which is `None` since 0.4.
    pub(super) fn persistent(&mut self) -> Result<(), TorchError> {
        const EXPECTED: &str = "('storage', class, key, location, numel)";
        let id = self.pop()?;
        let parts = match self.graph.node(id) {
            Node::Tuple(parts) => parts,
            other => return Err(self.unexpected(EXPECTED, other.kind())),
        };
        let (kind, class, key, len, view) = match **parts {
            [kind, class, key, _, len] => (kind, class, key, len, None),
            [kind, class, key, _, len, view] => (kind, class, key, len, Some(view)),
            _ => return Err(self.unexpected(EXPECTED, format!("a tuple of {}", parts.len()))),
        };
        if let Some(view) = view
            && !matches!(self.graph.node(view), Node::None)
        {
            return Err(self.unexpected("a storage that is not a view", self.graph.node(view).kind()));
        }
        let len = match self.graph.node(len) {
            Node::Int(len) => u64::try_from(*len).ok(),
            _ => None,
        };
        match (self.graph.text(kind), self.graph.node(class), self.graph.text(key), len) {
            (Some("storage"), Node::Global(Global::Storage(dtype)), Some(name), Some(len))
                if name.len() <= MAX_STORAGE_KEY_BYTES =>
            {
                let node = Node::Storage(StorageRef { dtype: *dtype, key, len });
                self.push(node);
                Ok(())
            }
            _ => Err(self.unexpected(EXPECTED, "another tuple")),
        }
    }

    pub(super) fn reduce(&mut self) -> Result<(), TorchError> {
        let (arguments, callable) = (self.pop()?, self.pop()?);
        let Node::Tuple(arguments) = self.graph.node(arguments) else {
            return Err(self.unexpected("a tuple of arguments", self.graph.node(arguments).kind()));
        };
        let node = match self.graph.node(callable) {
            Node::Global(Global::RebuildTensor) => self.tensor(arguments)?,
            Node::Global(Global::RebuildParameter) => {
                let parameter = match **arguments {
                    [data, _, _] if matches!(self.graph.node(data), Node::Tensor(_)) => data,
                    _ => return Err(self.unexpected("(tensor, requires_grad, hooks)", "other arguments")),
                };
                self.stack.push(parameter);
                return Ok(());
            }
            Node::Global(Global::OrderedDict) => {
                let entries = match **arguments {
                    [] => Vec::new(),
                    [pairs] => self.pairs(pairs)?,
                    _ => return Err(self.unexpected("at most one argument of OrderedDict", "more")),
                };
                self.copied = self.copied.saturating_add(entries.len());
                Node::Dict(entries)
            }
            other => return Err(self.unexpected("an allowed function to call", other.kind())),
        };
        self.push(node);
        Ok(())
    }

    fn tensor(&self, arguments: &[NodeId]) -> Result<Node, TorchError> {
        const EXPECTED: &str = "(storage, offset, size, stride) or (…, requires_grad, hooks)";
        let (storage, offset, shape, strides, metadata) = match *arguments {
            [storage, offset, shape, strides] | [storage, offset, shape, strides, _, _] => {
                (storage, offset, shape, strides, None)
            }
            [storage, offset, shape, strides, _, _, metadata] => (storage, offset, shape, strides, Some(metadata)),
            _ => return Err(self.unexpected(EXPECTED, format!("{} arguments", arguments.len()))),
        };
        if metadata.is_some_and(|metadata| !matches!(self.graph.node(metadata), Node::None)) {
            return Err(self.unexpected("a tensor without metadata", "a conjugated or negated view"));
        }
        let offset = match self.graph.node(offset) {
            Node::Int(offset) => u64::try_from(*offset).ok(),
            _ => None,
        };
        match (self.graph.node(storage), offset) {
            (Node::Storage(storage), Some(offset)) => {
                Ok(Node::Tensor(Box::new(TensorRef { storage: *storage, offset, shape, strides })))
            }
            (other, _) => Err(self.unexpected(EXPECTED, other.kind())),
        }
    }

    /// Python 2 pickles an `OrderedDict` as a call with a list of `[key, value]` lists. Repeated calls with the same
    /// memoised list must not copy more entries than the pickle has bytes.
    fn pairs(&self, list: NodeId) -> Result<Vec<(NodeId, NodeId)>, TorchError> {
        let Node::List(items) = self.graph.node(list) else {
            return Err(self.unexpected("a list of pairs", self.graph.node(list).kind()));
        };
        if self.copied.saturating_add(items.len()) > self.graph.source.len() {
            return Err(self.unexpected("dicts with entries of their own", "one list copied repeatedly"));
        }
        let pair = |&item: &NodeId| match self.graph.node(item) {
            Node::List(parts) => <[NodeId; 2]>::try_from(parts.as_slice()).ok(),
            Node::Tuple(parts) => <[NodeId; 2]>::try_from(&**parts).ok(),
            _ => None,
        };
        items
            .iter()
            .map(|item| pair(item).map(|[key, value]| (key, value)))
            .collect::<Option<_>>()
            .ok_or_else(|| self.unexpected("a list of pairs", "an item that is not a pair"))
    }

    /// Skips attributes: a `state_dict` has its `_metadata` as an attribute, but only its entries are data.
    pub(super) fn build(&mut self) -> Result<(), TorchError> {
        self.pop()?;
        let object = self.top()?;
        match self.graph.node(object) {
            Node::Dict(_) => Ok(()),
            other => Err(self.unexpected("a dict to set attributes of", other.kind())),
        }
    }
}
