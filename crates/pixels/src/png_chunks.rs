/// The chunks of a PNG in order, each stored as length (big endian), name, data and checksum (PNG specification, section 5.3): their
/// names and data. The last one has no data if it is cut short.
pub fn png_chunks(bytes: &[u8]) -> impl Iterator<Item = (&[u8; 4], Option<&[u8]>)> {
    const CHECKSUM: usize = 4;
    let mut rest = bytes.get(8..).unwrap_or_default();
    std::iter::from_fn(move || {
        let ([length, name], _) = rest.as_chunks::<4>().0.split_first_chunk::<2>()?;
        let end = usize::try_from(u32::from_be_bytes(*length)).ok()?.checked_add(8)?;
        let after = end.checked_add(CHECKSUM).and_then(|after| rest.get(after..));
        let data = after.and_then(|_| rest.get(8..end));
        rest = after.unwrap_or_default();
        Some((name, data))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_chunk_may_be_cut_short() {
        let whole = b"\x89PNG\r\n\x1a\n\0\0\0\x02tEXtab....\0\0\0\0IDAT....\0\0\0\x03IENDabc....";
        let of = |bytes: &'static [u8]| png_chunks(bytes).collect::<Vec<_>>();
        let text = (b"tEXt", Some(&b"ab"[..]));
        assert_eq!(of(whole), [text, (b"IDAT", Some(&b""[..])), (b"IEND", Some(&b"abc"[..]))]);
        assert_eq!(of(&whole[..whole.len() - 1])[2], (b"IEND", None), "without its checksum");
        assert_eq!(of(&whole[..30]), [text, (b"IDAT", None)]);
        assert_eq!(of(&whole[..29]), [text], "without its whole name");
        assert!(of(&whole[..7]).is_empty());
    }
}
