use burn::Tensor;
use burn::backend::Dispatch;

use crate::backend::{AttentionInputs, AttentionSizes, FusedOps};

/// Self-attention on packed queries, keys and values: `[batch, tokens, 3·width]` to `[batch, tokens, width]`.
///
/// A token consists of its queries, then its keys, then its values, each with `heads` adjacent heads of `width / heads` elements.
/// Per head, the result is `softmax(q kᵀ / √head_width) v`, computed tile by tile: nothing of size tokens × tokens is stored,
/// neither forward nor backward.
///
/// A logit of −∞ has weight 0. A query without keys, or with only logits of −∞, gives 0 and no gradient. A query with a logit
/// of NaN or +∞ gives NaN. A sample's result does not depend on its batch, bit for bit.
///
/// # Panics
/// If the shapes do not fit together.
pub fn self_attention(packed: Tensor<3>, heads: usize) -> Tensor<3> {
    let [batch, tokens, packed_width] = packed.dims();
    assert!(
        packed_width % 3 == 0,
        "expected queries, keys and values of one width, found tokens of {packed_width} elements"
    );
    let sizes = sizes(batch, tokens, tokens, packed_width / 3, heads);
    attend(AttentionInputs::Together(packed.into_dispatch()), sizes)
}

/// Cross-attention: `[batch, queries, width]` and packed keys and values `[batch, keys, 2·width]` to
/// `[batch, queries, width]`.
///
/// See [`self_attention`].
///
/// # Panics
/// If the shapes do not fit together.
pub fn cross_attention(queries: Tensor<3>, keys_values: Tensor<3>, heads: usize) -> Tensor<3> {
    let [batch, query_count, width] = queries.dims();
    let [key_batch, key_count, packed_width] = keys_values.dims();
    assert_eq!([key_batch, packed_width], [batch, 2 * width], "batch and width of packed keys and values");
    let sizes = sizes(batch, query_count, key_count, width, heads);
    let inputs = AttentionInputs::Apart { queries: queries.into_dispatch(), keys_values: keys_values.into_dispatch() };
    attend(inputs, sizes)
}

fn sizes(batch: usize, queries: usize, keys: usize, width: usize, heads: usize) -> AttentionSizes {
    assert!(
        heads > 0 && width > 0 && width.is_multiple_of(heads),
        "expected a width divisible by {heads} heads, found {width}"
    );
    AttentionSizes { batch, queries, keys, heads, head_width: width / heads }
}

fn attend(inputs: AttentionInputs<Dispatch>, sizes: AttentionSizes) -> Tensor<3> {
    Tensor::from_dispatch(Dispatch::fused_attention(inputs, sizes))
}
