use burn::Tensor;
use burn::backend::Dispatch;
use burn::tensor::Bool;

use crate::backend::{AttentionInputs, AttentionSizes, FusedOps, KeyMask};

/// Self-attention on packed queries, keys and values: `[batch, tokens, 3·width]` to `[batch, tokens, width]`.
///
/// A token holds its queries, then its keys, then its values; in each, `heads` heads lie side by side, of
/// `width / heads` elements. Per head, the result is `softmax(q kᵀ / √head_width) v`, computed tile by tile: nothing of
/// the size tokens × tokens is ever in memory, neither forward nor backward.
///
/// `ignored`, `[batch, tokens]`, is true at keys that no query sees. Their values must be finite all the same, since they
/// are multiplied by 0.
///
/// A logit of −∞ weighs nothing. A query that sees no key, or only keys at −∞, gives 0, and no gradient. A query with a
/// logit of NaN or +∞ gives NaN. A sample's result does not depend on the batch that it is in, bit for bit.
///
/// # Panics
/// When the shapes do not fit together.
pub fn self_attention(packed: Tensor<3>, heads: usize, ignored: Option<Tensor<2, Bool>>) -> Tensor<3> {
    let [batch, tokens, packed_width] = packed.dims();
    assert!(packed_width % 3 == 0, "queries, keys and values of one width in tokens of {packed_width} elements");
    let sizes = sizes(batch, tokens, tokens, packed_width / 3, heads);
    attend(AttentionInputs::Together(packed.into_dispatch()), sizes, ignored)
}

/// Attention from some tokens to others: `[batch, queries, width]` and packed keys and values `[batch, keys, 2·width]` to
/// `[batch, queries, width]`.
///
/// See [`self_attention`]; `ignored` is `[batch, keys]`.
///
/// # Panics
/// When the shapes do not fit together.
pub fn cross_attention(
    queries: Tensor<3>,
    keys_values: Tensor<3>,
    heads: usize,
    ignored: Option<Tensor<2, Bool>>,
) -> Tensor<3> {
    let [batch, query_count, width] = queries.dims();
    let [key_batch, key_count, packed_width] = keys_values.dims();
    assert_eq!([key_batch, packed_width], [batch, 2 * width], "batch and width of packed keys and values");
    let sizes = sizes(batch, query_count, key_count, width, heads);
    let inputs = AttentionInputs::Apart { queries: queries.into_dispatch(), keys_values: keys_values.into_dispatch() };
    attend(inputs, sizes, ignored)
}

fn sizes(batch: usize, queries: usize, keys: usize, width: usize, heads: usize) -> AttentionSizes {
    assert!(heads > 0 && width > 0 && width.is_multiple_of(heads), "{heads} heads of one width in {width} elements");
    AttentionSizes { batch, queries, keys, heads, head_width: width / heads }
}

fn attend(inputs: AttentionInputs<Dispatch>, sizes: AttentionSizes, ignored: Option<Tensor<2, Bool>>) -> Tensor<3> {
    if let Some(ignored) = &ignored {
        assert_eq!(ignored.dims(), [sizes.batch, sizes.keys], "shape of the mask of keys to ignore");
    }
    let mask = ignored.map_or(KeyMask::Absent, |ignored| KeyMask::Ignored(ignored.into_dispatch()));
    Tensor::from_dispatch(Dispatch::fused_attention(inputs, mask, sizes))
}
