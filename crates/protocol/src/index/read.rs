use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use atsplat_files::{Malformed, shortened};
use atsplat_scene::json;
use indexmap::IndexMap;
use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Serialize};

use super::{AbsentForm, EvaluationIndex, IndexEntry, IndexLayout, Overlap, SingleEntryForm, Spacing};
use crate::ProtocolError;

/// The value NoPoSplat uses for the overlap `"large"` (`src/dataset/view_sampler/view_sampler_evaluation.py:65`).
pub const OVERLAP_OF_LARGE: f64 = 0.75;
/// The value NoPoSplat uses for every other overlap word (same line), including `"medium"`, which thus counts as
/// small.
pub const OVERLAP_OF_OTHER_WORDS: f64 = 0.25;

/// What NoPoSplat's index of `ScanNet++` has in place of an overlap, which was not measured
/// (`assets/evaluation_index_scannetpp.json`).
const OVERLAP_NOT_MEASURED: f64 = -1.0;

/// The words that NoPoSplat's tagger writes (`src/misc/utils.py:38-48`).
const OVERLAP_WORDS: [&str; 4] = ["small", "medium", "large", "ignore"];

/// Name of the format in errors.
const WHAT: &str = "evaluation index";

const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Irregularities of an index file that do not prevent its use.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct IndexNotices {
    /// Scene keys that occur more than once, in the order of their repetitions. As in Python, the last
    /// value wins and the first position is kept.
    pub duplicate_keys: Vec<String>,
    /// Fields of entries that the format does not define, with their number of occurrences. They are dropped.
    pub unknown_fields: BTreeMap<String, u64>,
    /// Frames of the field `target` that are no targets, because `target_quantify` lists those to score.
    pub unscored_targets: u64,
    /// Entries whose overlap is a word instead of a number, read as [`OVERLAP_OF_LARGE`] or
    /// [`OVERLAP_OF_OTHER_WORDS`].
    pub overlap_words: u64,
    /// The first of these words.
    #[serde(skip)]
    pub first_overlap_word: Option<String>,
    /// Entries with -1 as their overlap, which NoPoSplat writes where none was measured: read as none.
    pub unmeasured_overlaps: u64,
}

/// The content of an index text, its layout and its irregularities.
pub(super) struct Parsed {
    pub(super) index: EvaluationIndex,
    pub(super) layout: IndexLayout,
    pub(super) notices: IndexNotices,
}

pub(super) fn parse(bytes: &[u8]) -> Result<Parsed, ProtocolError> {
    if bytes.starts_with(BYTE_ORDER_MARK) {
        let expected = "JSON that does not begin with a byte order mark, as for Python's reader";
        return Err(Malformed::new(WHAT, "line 1 column 1", expected, "one").into());
    }
    let reading = Reading::default();
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let scenes = ScenesSeed(&reading)
        .deserialize(&mut deserializer)
        .and_then(|scenes| deserializer.end().map(|()| scenes))
        .map_err(|error| reading.malformed(bytes, &error))?;
    let forms = reading.forms.into_inner();
    let layout = IndexLayout {
        spacing: Spacing::of_json(bytes),
        single_entry: forms.single_entry.unwrap_or_default(),
        absent: forms.absent.unwrap_or_default(),
        final_newline: bytes.ends_with(b"\n"),
    };
    Ok(Parsed { index: EvaluationIndex { scenes }, layout, notices: reading.notices.into_inner() })
}

/// What is collected while the value is deserialized.
#[derive(Default)]
struct Reading {
    notices: RefCell<IndexNotices>,
    forms: RefCell<Forms>,
    /// The path to an error, innermost step first; filled while the error propagates.
    trail: RefCell<Vec<Step>>,
}

/// The first form of each kind determines the layout; files that mix forms are written back uniformly.
#[derive(Default)]
struct Forms {
    single_entry: Option<SingleEntryForm>,
    absent: Option<AbsentForm>,
}

/// The most characters of a file that a message shows.
const SHOWN: usize = 80;

enum Step {
    Scene(String),
    Entry(usize),
    Field(&'static str),
    Element(usize),
}

impl fmt::Display for Step {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scene(key) => write!(f, "scene {:?}", shortened(key, SHOWN)),
            Self::Entry(position) => write!(f, "entry {position}"),
            Self::Field(name) => write!(f, "field {name}"),
            Self::Element(position) => write!(f, "element {position}"),
        }
    }
}

impl Reading {
    /// Adds `step` to the path of an error.
    fn within<T, E>(&self, result: Result<T, E>, step: impl FnOnce() -> Step) -> Result<T, E> {
        if result.is_err() {
            self.trail.borrow_mut().push(step());
        }
        result
    }

    /// Stores the value of a field, which must occur once.
    fn field<T, E: Error>(&self, name: &'static str, place: &mut Option<T>, value: Result<T, E>) -> Result<(), E> {
        match place.replace(self.within(value, || Step::Field(name))?) {
            None => Ok(()),
            Some(_) => Err(E::custom(format!("it twice, expected the field {name} once"))),
        }
    }

    fn malformed(&self, bytes: &[u8], error: &serde_json::Error) -> ProtocolError {
        let mut steps: Vec<String> = self.trail.borrow().iter().rev().map(Step::to_string).collect();
        steps.push(format!("line {} column {}", error.line(), error.column()));
        if error.is_syntax() {
            let (expected, found) = json::problem(bytes, error, "an index");
            return Malformed::new(WHAT, steps.join(", "), expected, found).into();
        }
        let message = error.to_string();
        let message = message.rsplit_once(" at line ").map_or(message.as_str(), |(message, _)| message);
        let (found, expected) = message.rsplit_once(", expected ").unwrap_or((message, "JSON"));
        let found =
            ["invalid type: ", "invalid value: "].iter().find_map(|prefix| found.strip_prefix(prefix)).unwrap_or(found);
        Malformed::new(WHAT, steps.join(", "), expected, shortened(found, SHOWN)).into()
    }
}

/// Seeds that share a [`Reading`] and deserialize by themselves as visitors.
macro_rules! seeds {
    ($($name:ident: $value:ty, $deserialize:ident;)*) => {$(
        struct $name<'a>(&'a Reading);

        impl<'de> DeserializeSeed<'de> for $name<'_> {
            type Value = $value;

            fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
                deserializer.$deserialize(self)
            }
        }
    )*};
}

seeds! {
    ScenesSeed: IndexMap<String, Vec<IndexEntry>>, deserialize_map;
    SceneSeed: Vec<IndexEntry>, deserialize_any;
    EntrySeed: IndexEntry, deserialize_map;
    FramesSeed: Vec<usize>, deserialize_seq;
    OverlapSeed: Option<f64>, deserialize_any;
}

impl<'de> Visitor<'de> for ScenesSeed<'_> {
    type Value = IndexMap<String, Vec<IndexEntry>>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object from scene keys to entries")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let Self(reading) = self;
        let mut scenes = IndexMap::new();
        while let Some(key) = map.next_key::<String>()? {
            let entries = reading.within(map.next_value_seed(SceneSeed(reading)), || Step::Scene(key.clone()))?;
            match scenes.entry(key) {
                indexmap::map::Entry::Vacant(place) => {
                    place.insert(entries);
                }
                indexmap::map::Entry::Occupied(mut place) => {
                    reading.notices.borrow_mut().duplicate_keys.push(place.key().clone());
                    place.insert(entries);
                }
            }
        }
        Ok(scenes)
    }
}

impl<'de> Visitor<'de> for SceneSeed<'_> {
    type Value = Vec<IndexEntry>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("null, an entry or a list of entries")
    }

    fn visit_unit<E: Error>(self) -> Result<Self::Value, E> {
        self.0.forms.borrow_mut().absent.get_or_insert(AbsentForm::Null);
        Ok(Vec::new())
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
        self.0.forms.borrow_mut().single_entry.get_or_insert(SingleEntryForm::Object);
        Ok(vec![EntrySeed(self.0).visit_map(map)?])
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
        let Self(reading) = self;
        let mut entries = Vec::new();
        while let Some(entry) =
            reading.within(list.next_element_seed(EntrySeed(reading)), || Step::Entry(entries.len()))?
        {
            entries.push(entry);
        }
        match entries.len() {
            0 => {
                reading.forms.borrow_mut().absent.get_or_insert(AbsentForm::EmptyList);
            }
            1 => {
                reading.forms.borrow_mut().single_entry.get_or_insert(SingleEntryForm::List);
            }
            _ => {}
        }
        Ok(entries)
    }
}

impl<'de> Visitor<'de> for EntrySeed<'_> {
    type Value = IndexEntry;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an entry with the fields context and target")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let Self(reading) = self;
        let (mut context, mut target, mut scored, mut overlap, mut estimator) = (None, None, None, None, None);
        while let Some(name) = map.next_key::<String>()? {
            match name.as_str() {
                "context" => reading.field("context", &mut context, map.next_value_seed(FramesSeed(reading)))?,
                "target" => reading.field("target", &mut target, map.next_value_seed(FramesSeed(reading)))?,
                SCORED => reading.field(SCORED, &mut scored, map.next_value::<Option<Vec<Frame>>>())?,
                "overlap" => reading.field("overlap", &mut overlap, map.next_value_seed(OverlapSeed(reading)))?,
                ESTIMATOR => reading.field(ESTIMATOR, &mut estimator, map.next_value::<Option<String>>())?,
                _ => {
                    map.next_value::<IgnoredAny>()?;
                    *reading.notices.borrow_mut().unknown_fields.entry(name).or_default() += 1;
                }
            }
        }
        let overlap = reading.within(overlap_of(overlap.flatten(), estimator.flatten()), || Step::Field(ESTIMATOR))?;
        let context = context.ok_or_else(|| absent("context"))?;
        let rendered = target.ok_or_else(|| absent("target"))?;
        let target = reading.within(
            scored_targets(rendered, scored.flatten(), &mut reading.notices.borrow_mut().unscored_targets),
            || Step::Field(SCORED),
        )?;
        Ok(IndexEntry { context, target, overlap })
    }
}

/// The targets that are scored, and how many others are rendered. `MVSplat360` renders 14 frames for its video model and keeps the images
/// of the scored ones alone (`src/model/model_wrapper.py:316-350`).
fn scored_targets<E: Error>(
    rendered: Vec<usize>,
    scored: Option<Vec<Frame>>,
    unscored: &mut u64,
) -> Result<Vec<usize>, E> {
    let Some(scored) = scored else { return Ok(rendered) };
    let scored: Vec<usize> = scored.into_iter().map(|Frame(frame)| frame).collect();
    let all: BTreeSet<usize> = rendered.iter().copied().collect();
    if let Some(other) = scored.iter().find(|frame| !all.contains(*frame)) {
        return Err(E::custom(format!("frame {other}, which is no target, expected frames of the field target")));
    }
    let kept: BTreeSet<usize> = scored.iter().copied().collect();
    *unscored += rendered.iter().filter(|frame| !kept.contains(*frame)).count() as u64;
    Ok(scored)
}

/// An estimator without a value is an error.
fn overlap_of<E: Error>(value: Option<f64>, estimator: Option<String>) -> Result<Option<Overlap>, E> {
    match (value, estimator) {
        (None, Some(name)) => Err(E::custom(format!("{name:?} without an overlap, expected the field overlap too"))),
        (value, estimator) => Ok(value.map(|value| Overlap { value, estimator })),
    }
}

fn absent<E: Error>(field: &str) -> E {
    E::custom(format!("an entry without it, expected the field {field}"))
}

/// Which estimator measured an entry's overlap: a field of this toolkit, which published loaders ignore.
const ESTIMATOR: &str = "overlap_estimator";

/// Which frames of `target` are scored: a field of `MVSplat360`'s indices
/// (`src/dataset/view_sampler/view_sampler_evaluation.py:95-99`).
const SCORED: &str = "target_quantify";

impl<'de> Visitor<'de> for FramesSeed<'_> {
    type Value = Vec<usize>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of frame numbers")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
        let mut frames = Vec::new();
        while let Some(Frame(frame)) = self.0.within(list.next_element(), || Step::Element(frames.len()))? {
            frames.push(frame);
        }
        Ok(frames)
    }
}

struct Frame(usize);

impl<'de> Deserialize<'de> for Frame {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct FrameVisitor;
        impl Visitor<'_> for FrameVisitor {
            type Value = Frame;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a whole frame number from 0 to {}", IndexEntry::MAX_FRAME)
            }

            fn visit_u64<E: Error>(self, value: u64) -> Result<Frame, E> {
                usize::try_from(value)
                    .ok()
                    .filter(|frame| *frame <= IndexEntry::MAX_FRAME)
                    .map(Frame)
                    .ok_or_else(|| E::invalid_value(Unexpected::Unsigned(value), &self))
            }
        }
        deserializer.deserialize_u64(FrameVisitor)
    }
}

/// The value that NoPoSplat reads a word as: it has no value for `"ignore"`, which is a small overlap there.
pub(super) fn value_of_word(word: &str) -> f64 {
    if word == "large" { OVERLAP_OF_LARGE } else { OVERLAP_OF_OTHER_WORDS }
}

impl Visitor<'_> for OverlapSeed<'_> {
    type Value = Option<f64>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a number from 0 to 1, null, or one of {}", OVERLAP_WORDS.join(" "))
    }

    fn visit_unit<E: Error>(self) -> Result<Self::Value, E> {
        Ok(None)
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Self::Value, E> {
        if (0.0..=1.0).contains(&value) {
            Ok(Some(value))
        } else if value.total_cmp(&OVERLAP_NOT_MEASURED).is_eq() {
            self.0.notices.borrow_mut().unmeasured_overlaps += 1;
            Ok(None)
        } else {
            Err(E::invalid_value(Unexpected::Float(value), &self))
        }
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Self::Value, E> {
        self.visit_f64(value as f64)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Self::Value, E> {
        self.visit_f64(value as f64)
    }

    fn visit_str<E: Error>(self, word: &str) -> Result<Self::Value, E> {
        if !OVERLAP_WORDS.contains(&word) {
            return Err(E::invalid_value(Unexpected::Str(word), &self));
        }
        let mut notices = self.0.notices.borrow_mut();
        notices.overlap_words += 1;
        notices.first_overlap_word.get_or_insert_with(|| word.to_owned());
        Ok(Some(value_of_word(word)))
    }
}

#[cfg(test)]
mod tests;
