//! Interprets the subset of Python's pickle opcodes that `torch.save` writes (described in `CPython`
//! `Lib/pickletools.py`): containers, strings, numbers, and tensors through an allow-list of names. It never calls Python
//! functions, and its memory is proportional to the bytes read.

mod objects;

use std::ops::Range;

use crate::TorchError;
use crate::globals::Global;
use crate::graph::{Graph, Node, NodeId};
use crate::shared_bytes::array_at;
use crate::shortened;

/// Maximum length of a pickle. A chunk needs about 70 bytes per image.
const MAX_PICKLE_BYTES: usize = 256 << 20;
const HIGHEST_PROTOCOL: u8 = 5;
/// A memo slot without an object.
const EMPTY: NodeId = NodeId::MAX;

/// A completely interpreted pickle.
pub(crate) struct Parsed<'a> {
    pub(crate) graph: Graph<'a>,
    pub(crate) root: NodeId,
    /// Offset of the byte after the pickle.
    pub(crate) end: usize,
}

/// Interprets the pickle that starts at `start`; offsets in errors are relative to `bytes`.
pub(crate) fn parse(bytes: &[u8], start: usize) -> Result<Parsed<'_>, TorchError> {
    let limit = bytes.len().min(start.saturating_add(MAX_PICKLE_BYTES));
    let source = &bytes[..limit];
    if u32::try_from(limit).is_err() {
        return Err(TorchError::unsupported(format!("byte {start}"), "a pickle beyond 4 GiB"));
    }
    let mut interpreter = Interpreter {
        graph: Graph { nodes: Vec::new(), source },
        start,
        at: start,
        opcode_at: start,
        stack: Vec::new(),
        marks: Vec::new(),
        memo: Vec::new(),
        remembered: 0,
        copied: 0,
    };
    let root = loop {
        if let Some(root) = interpreter.step()? {
            break root;
        }
    };
    Ok(Parsed { graph: interpreter.graph, root, end: interpreter.at })
}

struct Interpreter<'a> {
    graph: Graph<'a>,
    start: usize,
    at: usize,
    /// Offset of the current opcode, for errors.
    opcode_at: usize,
    stack: Vec<NodeId>,
    /// Height of the stack at each MARK.
    marks: Vec<usize>,
    /// Objects by slot, [`EMPTY`] if there is none. A pickler numbers its slots in order.
    memo: Vec<NodeId>,
    /// Number of filled slots.
    remembered: u32,
    /// Number of dict entries copied from lists.
    copied: usize,
}

impl<'a> Interpreter<'a> {
    /// Interprets one opcode; returns the root object at STOP.
    fn step(&mut self) -> Result<Option<NodeId>, TorchError> {
        self.opcode_at = self.at;
        let [opcode] = self.array()?;
        match opcode {
            b'.' => return self.pop().map(Some),
            0x80 => self.protocol()?,
            0x95 => self.frame()?,
            b'(' => self.marks.push(self.stack.len()),
            b'0' => self.discard()?,
            b'1' => drop(self.pop_to_mark()?),
            b'N' => self.push(Node::None),
            0x88 => self.push(Node::Bool(true)),
            0x89 => self.push(Node::Bool(false)),
            b'J' | b'K' | b'M' | b'I' | b'L' | b'G' | 0x8a | 0x8b => {
                let number = self.number(opcode)?;
                self.push(number);
            }
            b'X' | b'T' | b'U' | 0x8c | 0x8d => self.text(opcode)?,
            b'B' | b'C' | 0x8e => self.raw_bytes(opcode)?,
            b')' => self.push(Node::Tuple(Box::default())),
            b']' => self.push(Node::List(Vec::new())),
            b'}' => self.push(Node::Dict(Vec::new())),
            b't' => {
                let items = self.pop_to_mark()?.into_boxed_slice();
                self.push(Node::Tuple(items));
            }
            0x85..=0x87 => self.short_tuple(usize::from(opcode - 0x84))?,
            b'a' => {
                let item = self.pop()?;
                self.append(&[item])?;
            }
            b'e' => {
                let items = self.pop_to_mark()?;
                self.append(&items)?;
            }
            b's' => {
                let (value, key) = (self.pop()?, self.pop()?);
                self.set_items(&[key, value])?;
            }
            b'u' => {
                let items = self.pop_to_mark()?;
                self.set_items(&items)?;
            }
            b'q' => {
                let [slot] = self.array()?;
                self.remember(u32::from(slot))?;
            }
            b'r' => {
                let slot = u32::from_le_bytes(self.array()?);
                self.remember(slot)?;
            }
            0x94 => self.remember(self.remembered)?,
            b'h' => {
                let [slot] = self.array()?;
                self.recall(u32::from(slot))?;
            }
            b'j' => {
                let slot = u32::from_le_bytes(self.array()?);
                self.recall(slot)?;
            }
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                self.global(module, name)?;
            }
            0x93 => {
                let (name, module) = (self.pop()?, self.pop()?);
                match (self.graph.text(module), self.graph.text(name)) {
                    (Some(module), Some(name)) => self.global(module, name)?,
                    _ => return Err(self.unexpected("a module and a name", "other objects")),
                }
            }
            b'Q' => self.persistent()?,
            b'R' => self.reduce()?,
            b'b' => self.build()?,
            opcode => return Err(TorchError::ForbiddenOpcode { offset: self.opcode_at, opcode }),
        }
        Ok(None)
    }

    fn protocol(&mut self) -> Result<(), TorchError> {
        match self.array()? {
            [0..=HIGHEST_PROTOCOL] => Ok(()),
            [found] => Err(self.unexpected(format!("pickle protocol 0 to {HIGHEST_PROTOCOL}"), found.to_string())),
        }
    }

    /// Frames only help a stream to read ahead, but the length must be valid.
    fn frame(&mut self) -> Result<(), TorchError> {
        let len = u64::from_le_bytes(self.array()?);
        let left = self.graph.source.len().saturating_sub(self.at) as u64;
        if len > left {
            return Err(self.unexpected(format!("a frame of at most {left} bytes"), len.to_string()));
        }
        Ok(())
    }

    fn discard(&mut self) -> Result<(), TorchError> {
        if self.marks.last() == Some(&self.stack.len()) {
            self.marks.pop();
            return Ok(());
        }
        self.pop().map(drop)
    }

    fn number(&mut self, opcode: u8) -> Result<Node, TorchError> {
        match opcode {
            b'K' => self.array().map(|[value]| Node::Int(i64::from(value))),
            b'M' => self.array().map(|value| Node::Int(i64::from(u16::from_le_bytes(value)))),
            b'J' => self.array().map(|value| Node::Int(i64::from(i32::from_le_bytes(value)))),
            b'G' => self.array().map(|value| Node::Float(f64::from_be_bytes(value))),
            b'I' | b'L' => self.decimal(),
            _ => self.long(opcode == 0x8b),
        }
    }

    /// Integers of protocols 0 and 1; `I00` and `I01` are booleans.
    fn decimal(&mut self) -> Result<Node, TorchError> {
        match self.line()? {
            "00" => Ok(Node::Bool(false)),
            "01" => Ok(Node::Bool(true)),
            digits => {
                let digits = digits.strip_suffix('L').unwrap_or(digits);
                digits.parse().map(Node::Int).map_err(|source: std::num::ParseIntError| {
                    self.unexpected("an integer of 64 bits", format!("{:?} ({source})", shortened(digits)))
                })
            }
        }
    }

    fn long(&mut self, four_byte_length: bool) -> Result<Node, TorchError> {
        let len = if four_byte_length {
            i64::from(i32::from_le_bytes(self.array()?))
        } else {
            let [len] = self.array()?;
            i64::from(len)
        };
        let Ok(len @ 0..=8) = usize::try_from(len) else {
            return Err(self.unexpected("an integer of at most 8 bytes", format!("{len} bytes")));
        };
        let bytes = self.take(len)?;
        let sign = if bytes.last().is_some_and(|top| top & 0x80 != 0) { 0xff } else { 0 };
        let mut wide = [sign; 8];
        for (to, from) in wide.iter_mut().zip(bytes) {
            *to = *from;
        }
        Ok(Node::Int(i64::from_le_bytes(wide)))
    }

    fn text(&mut self, opcode: u8) -> Result<(), TorchError> {
        let range = self.sized(opcode)?;
        if let Err(source) = std::str::from_utf8(self.graph.slice(&range)) {
            return Err(self.unexpected("text in UTF-8", source.to_string()));
        }
        self.push(Node::Str(range));
        Ok(())
    }

    fn raw_bytes(&mut self, opcode: u8) -> Result<(), TorchError> {
        let range = self.sized(opcode)?;
        self.push(Node::Bytes(range));
        Ok(())
    }

    /// The range of a string with a length prefix of one, four or eight bytes.
    fn sized(&mut self, opcode: u8) -> Result<Range<u32>, TorchError> {
        let len = match opcode {
            b'U' | b'C' | 0x8c => {
                let [len] = self.array()?;
                u64::from(len)
            }
            0x8d | 0x8e => u64::from_le_bytes(self.array()?),
            _ => u64::from(u32::from_le_bytes(self.array()?)),
        };
        let start = self.at;
        let bytes = usize::try_from(len).ok().and_then(|len| self.take(len).ok());
        let ends = (u32::try_from(start), u32::try_from(self.at));
        match (bytes, ends) {
            (Some(_), (Ok(start), Ok(end))) => Ok(start..end),
            _ => Err(self.unexpected(format!("{len} bytes of text"), "the end of the pickle")),
        }
    }

    fn short_tuple(&mut self, len: usize) -> Result<(), TorchError> {
        let floor = self.marks.last().copied().unwrap_or_default();
        match self.stack.len().checked_sub(len) {
            Some(from) if from >= floor => {
                let items = self.stack.split_off(from).into_boxed_slice();
                self.push(Node::Tuple(items));
                Ok(())
            }
            _ => Err(self.unexpected(format!("{len} objects on the stack"), "fewer")),
        }
    }

    fn append(&mut self, items: &[NodeId]) -> Result<(), TorchError> {
        let list = self.top()?;
        match self.graph.nodes.get_mut(list as usize) {
            Some(Node::List(held)) => {
                held.extend_from_slice(items);
                Ok(())
            }
            _ => Err(self.unexpected("a list to append to", self.graph.node(list).kind())),
        }
    }

    fn set_items(&mut self, items: &[NodeId]) -> Result<(), TorchError> {
        let dict = self.top()?;
        let (pairs, odd) = items.as_chunks::<2>();
        match self.graph.nodes.get_mut(dict as usize) {
            Some(Node::Dict(held)) if odd.is_empty() => {
                held.extend(pairs.iter().map(|&[key, value]| (key, value)));
                Ok(())
            }
            Some(Node::Dict(_)) => Err(self.unexpected("keys with values", "a key without a value")),
            _ => Err(self.unexpected("a dict to fill", self.graph.node(dict).kind())),
        }
    }

    fn remember(&mut self, slot: u32) -> Result<(), TorchError> {
        let top = self.top()?;
        let read = self.at.saturating_sub(self.start);
        let Some(slot) = usize::try_from(slot).ok().filter(|slot| *slot < read) else {
            return Err(self.unexpected(format!("a memo slot below {read}, the bytes read so far"), slot.to_string()));
        };
        if slot >= self.memo.len() {
            self.memo.resize(slot + 1, EMPTY);
        }
        if let Some(held) = self.memo.get_mut(slot) {
            self.remembered += u32::from(*held == EMPTY);
            *held = top;
        }
        Ok(())
    }

    fn recall(&mut self, slot: u32) -> Result<(), TorchError> {
        let held = self.memo.get(slot as usize).copied().filter(|held| *held != EMPTY);
        let node = held.ok_or_else(|| self.unexpected(format!("an object in memo {slot}"), "none"))?;
        self.stack.push(node);
        Ok(())
    }

    fn global(&mut self, module: &str, name: &str) -> Result<(), TorchError> {
        let allowed = Global::allowed(module, name).ok_or_else(|| TorchError::ForbiddenGlobal {
            offset: self.opcode_at,
            global: format!("{} {}", shortened(module), shortened(name)),
        })?;
        self.push(Node::Global(allowed));
        Ok(())
    }

    fn push(&mut self, node: Node) {
        let id = u32::try_from(self.graph.nodes.len());
        let id = id.unwrap_or_else(|_| unreachable!("each node has at least one byte of a source below 4 GiB"));
        self.graph.nodes.push(node);
        self.stack.push(id);
    }

    fn pop(&mut self) -> Result<NodeId, TorchError> {
        let top = self.top()?;
        self.stack.pop();
        Ok(top)
    }

    fn top(&self) -> Result<NodeId, TorchError> {
        let floor = self.marks.last().copied().unwrap_or_default();
        let above = self.stack.get(floor..).unwrap_or_default();
        above.last().copied().ok_or_else(|| self.unexpected("an object on the stack", "none"))
    }

    fn pop_to_mark(&mut self) -> Result<Vec<NodeId>, TorchError> {
        match self.marks.pop() {
            Some(mark) if mark <= self.stack.len() => Ok(self.stack.split_off(mark)),
            _ => Err(self.unexpected("a mark on the stack", "none")),
        }
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], TorchError> {
        let bytes = array_at(self.graph.source, self.at).ok_or_else(|| self.truncated())?;
        self.at += N;
        Ok(bytes)
    }

    fn take(&mut self, len: usize) -> Result<&'a [u8], TorchError> {
        let source = self.graph.source;
        let end = self.at.checked_add(len).ok_or_else(|| self.truncated())?;
        let bytes = source.get(self.at..end).ok_or_else(|| self.truncated())?;
        self.at = end;
        Ok(bytes)
    }

    /// Text up to a newline, which is skipped.
    fn line(&mut self) -> Result<&'a str, TorchError> {
        let rest = self.graph.source.get(self.at..).unwrap_or_default();
        let len = rest.iter().position(|&byte| byte == b'\n').ok_or_else(|| self.truncated())?;
        let line = self.take(len)?;
        self.at += 1;
        std::str::from_utf8(line).map_err(|source| self.unexpected("a line of UTF-8", source.to_string()))
    }

    fn truncated(&self) -> TorchError {
        self.unexpected("more bytes", "the end of the pickle")
    }

    fn unexpected(&self, expected: impl Into<String>, found: impl Into<String>) -> TorchError {
        TorchError::malformed(format!("pickle byte {}", self.opcode_at), expected, found)
    }
}
