use atsplat_files::Sha256Digest;
use serde::Serialize;

/// An official evaluation index: a file shipped by a published repository.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct KnownIndex {
    /// Name in this toolkit, unique and stable: `<repository>-<dataset>[-<variant>]`.
    pub name: &'static str,
    /// Where it was first published, as `owner/repository`.
    pub repository: &'static str,
    /// Path inside that repository.
    pub path: &'static str,
    /// Dataset of its scene keys, as [`NamedDataset::id`](crate::NamedDataset::id).
    pub dataset: &'static str,
    /// Hash of the published file's bytes.
    pub sha256: Sha256Digest,
    /// [`crate::EvaluationIndex::content_hash`], so that a reformatted copy is recognised too.
    pub content: Sha256Digest,
    /// Smallest and largest number of targets of an entry.
    pub targets: (usize, usize),
    /// What to know before comparing numbers on it.
    pub notes: &'static str,
}

impl KnownIndex {
    /// The official file with these bytes.
    pub fn by_sha256(sha256: &Sha256Digest) -> Option<&'static Self> {
        KNOWN_INDICES.iter().find(|known| known.sha256 == *sha256)
    }

    /// The official file that defines the same trials.
    pub fn by_content(content: &Sha256Digest) -> Option<&'static Self> {
        KNOWN_INDICES.iter().find(|known| known.content == *content)
    }

    /// The official file with this [`Self::name`].
    pub fn by_name(name: &str) -> Option<&'static Self> {
        KNOWN_INDICES.iter().find(|known| known.name == name)
    }
}

/// All official index files that this toolkit recognises.
pub const KNOWN_INDICES: &[KnownIndex] = &[
    KnownIndex {
        name: "pixelsplat-re10k",
        repository: "dcharatan/pixelsplat",
        path: "assets/evaluation_index_re10k.json",
        dataset: "re10k",
        sha256: Sha256Digest::literal("fbcff9b4b13139227d809af45b84bb5a7a9cdb1c7a55bced85b6c66556a219cc"),
        content: Sha256Digest::literal("322cf5b82ae91f883c8db4eb92ed53fdd4aa509901586d86480a409bab53912c"),
        targets: (3, 3),
        notes: "byte-identical in MVSplat, DepthSplat and iLRM; 583 of 19422 targets are context frames",
    },
    KnownIndex {
        name: "pixelsplat-acid",
        repository: "dcharatan/pixelsplat",
        path: "assets/evaluation_index_acid.json",
        dataset: "acid",
        sha256: Sha256Digest::literal("7a08cf5c612b60b407c4cd395ff945180d852e1f7f4c0442102ad85e0e3a2fd1"),
        content: Sha256Digest::literal("7f922d4fee0bb3ddcf6ba8a68f8331d385a2a4fd5c4c48f511af92e750620b1f"),
        targets: (3, 3),
        notes: "135 of 4785 targets are context frames",
    },
    KnownIndex {
        name: "noposplat-re10k",
        repository: "cvg/NoPoSplat",
        path: "assets/evaluation_index_re10k.json",
        dataset: "re10k",
        sha256: Sha256Digest::literal("4940dbd54f98dec8c0db6854f6ff97456856d437b85e3808fd3747ecca68c8fe"),
        content: Sha256Digest::literal("de6d3055126d3747cff327101c461047f26f2f37a2dd708b6614acabca579804"),
        targets: (3, 3),
        notes: "same file name as pixelSplat's and no entry in common with it; wider baselines, an overlap per scene; \
                447 of 16803 targets are context frames",
    },
    KnownIndex {
        name: "noposplat-acid",
        repository: "cvg/NoPoSplat",
        path: "assets/evaluation_index_acid.json",
        dataset: "acid",
        sha256: Sha256Digest::literal("e3983f0e7d2ddda9627478139f6fc4bb1e166fa19a934c33d43bb613e5e1be89"),
        content: Sha256Digest::literal("414500f193ffa2021c12b80a6ef33e8b5bb52923ec5104d7b39908df55d4e3a0"),
        targets: (3, 3),
        notes: "same file name as pixelSplat's, another protocol; an overlap per scene",
    },
    KnownIndex {
        name: "depthsplat-dl3dv-2v",
        repository: "cvg/depthsplat",
        path: "assets/dl3dv_start_0_distance_50_ctx_2v_video_0_50.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("434c3e1bd9395cf7f0f2f0dc787d15a9bddd87865891fd5817fdfa6e711ad46d"),
        content: Sha256Digest::literal("b655a5c230090d2624bad9cb1e29c4109b537984a508d41ff57050d84b25c5e8"),
        targets: (50, 50),
        notes: "targets are frames 0..49, the context frames included: 280 of 7000 are leaked",
    },
    KnownIndex {
        name: "depthsplat-dl3dv-4v",
        repository: "cvg/depthsplat",
        path: "assets/dl3dv_start_0_distance_50_ctx_4v_video_0_50.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("2bae3240e42b6f2bddd21ac20752c65996e2923d0606dbffef7d15fee33beeca"),
        content: Sha256Digest::literal("d0bee96dcb1f54954f4ddb18209fc9c5a826f8b7523857e7fb19972538d353b9"),
        targets: (50, 50),
        notes: "targets are frames 0..49, the context frames included: 560 of 7000 are leaked",
    },
    KnownIndex {
        name: "depthsplat-dl3dv-6v",
        repository: "cvg/depthsplat",
        path: "assets/dl3dv_start_0_distance_50_ctx_6v_video_0_50.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("3ab98877ef792fa91f2dd2982e7ea62c4033a1fb04a65fb63288e7a7ae3c4b9e"),
        content: Sha256Digest::literal("e6f01560b661cd3d5be19b81d4e237b9f4d97a3f5defbf3727db21e47f824dc8"),
        targets: (50, 50),
        notes: "targets are frames 0..49, the context frames included: 840 of 7000 are leaked",
    },
    KnownIndex {
        name: "depthsplat-dl3dv-12v",
        repository: "cvg/depthsplat",
        path: "assets/dl3dv_start_0_distance_100_ctx_12v_video.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("3fe8659556e9395a19382c3c86e247234204db328cf3bbc8d67f9e2cdf4870d5"),
        content: Sha256Digest::literal("a1b7c956f4f98bc6725ed9dcb6b3441c1cd110521e8359dc62ade35b36aa22b5"),
        targets: (87, 100),
        notes: "targets are every frame of the window, 87 to 100 a scene, the 12 context frames included",
    },
    KnownIndex {
        name: "depthsplat-dl3dv-2v-10",
        repository: "cvg/depthsplat",
        path: "assets/dl3dv_start_0_distance_10_ctx_2v_tgt_4v.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("eab21290cfab8eff12e208377b089b2a65e15f7ba44f7bb085963511354863f4"),
        content: Sha256Digest::literal("9544cbf06d2f9fca7732c6c5a908e476c7c751b6b514859fef1629b16843cdda"),
        targets: (4, 4),
        notes: "DepthSplat's zero-shot file: a window of 10 frames, much easier than the 50-frame files",
    },
    KnownIndex {
        name: "yonosplat-dl3dv-6v",
        repository: "cvg/YoNoSplat",
        path: "assets/dl3dv_start_0_distance_50_ctx_6v_tgt_8v.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("602d0b38e7f003ccfac8b634fb48d5f853004dd0481c307fd61af2ff90b770b9"),
        content: Sha256Digest::literal("438d1afba0b45c8b82e08433879d8cedb83dde0353d2a19b1ef376b00b6b25b3"),
        targets: (8, 8),
        notes: "DepthSplat's 6-view contexts with 8 targets, none of them a context frame; read from the fork \
                lksrz/YoNoSplat",
    },
    KnownIndex {
        name: "yonosplat-dl3dv-12v",
        repository: "cvg/YoNoSplat",
        path: "assets/dl3dv_start_0_distance_100_ctx_12v_tgt_8v.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("4e191e1feb32a340ec4ec8fa77e7859bf8f44591fda0c1c3ea250619acd562fa"),
        content: Sha256Digest::literal("42bee6d502724a25f38be30939e1d51afd41c62b9b89c6e422ca140f7931da3e"),
        targets: (8, 8),
        notes: "DepthSplat's 12-view contexts with 8 random targets, 137 of 1120 leaked; read from the fork \
                lksrz/YoNoSplat",
    },
    KnownIndex {
        name: "latentsplat-re10k-extra",
        repository: "Chrixtar/latentsplat",
        path: "assets/evaluation_index/re10k_extra.json",
        dataset: "re10k",
        sha256: Sha256Digest::literal("4b280fa193d16fe25ab9faa4cb638f565e80c372b4661ec8f6edcda125af70ec"),
        content: Sha256Digest::literal("f884113bfc75742f4a7ce0aec466212c85299e2a0a36771582065a89e884831d"),
        targets: (3, 3),
        notes: "extrapolation: every target is up to 45 frames outside the window",
    },
    KnownIndex {
        name: "latentsplat-re10k-intra",
        repository: "Chrixtar/latentsplat",
        path: "assets/evaluation_index/re10k_intra.json",
        dataset: "re10k",
        sha256: Sha256Digest::literal("b1909a06e34b7346b7a8cd46a1efa0e44210d2d5fff87c4e00130d2e0fa2b084"),
        content: Sha256Digest::literal("cdece5e7873a703532bb945ed74db7c49484cc832352acae762c5d40373dc755"),
        targets: (3, 3),
        notes: "interpolation: other pairs than pixelSplat's in all but 49 scenes; 608 of 19422 targets are context frames",
    },
    KnownIndex {
        name: "mvsplat360-dl3dv-5v",
        repository: "donydchen/mvsplat360",
        path: "assets/dl3dv_evaluation/dl3dv_ctx_5v_tgt_56v.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("2aec4a2313c260cc059aae8b5ab9fa90a1156a4224f166c4f654d7c6f7dadb69"),
        content: Sha256Digest::literal("9cb80892402f5f60843dc58a8daacea0243551e32351241445b506aea19ecfe3"),
        targets: (56, 56),
        notes: "views over the whole scene; 1264 of 7840 targets are outside the window",
    },
    KnownIndex {
        name: "mvsplat360-dl3dv-5v-n150",
        repository: "donydchen/mvsplat360",
        path: "assets/dl3dv_evaluation/dl3dv_ctx_5v_tgt_56v_n150.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("ebc31a7ef9fff10231c23eaa42e2815761cf8dafa23925699232a749c3fd9abe"),
        content: Sha256Digest::literal("c62fc3d034aaf9fee997f5633d2a809c5d1763a5deb4bc6c194015015ed82804"),
        targets: (56, 56),
        notes: "views over about the first half of the scene; 686 of 7840 targets are outside the window",
    },
    KnownIndex {
        name: "zpressor-dl3dv-12v",
        repository: "ziplab/ZPressor",
        path: "depthsplat/assets/dl3dv_evaluation/dl3dv_ctx_12v_tgt_8v_n50.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("c8698750b21523a7dfe6d5dd4cbe89d0ac417b76a4e6e020725ab039b120cc4b"),
        content: Sha256Digest::literal("f0bbfd77b720d749a5cb27b1818d2afe1107743c6d5883122133348d5f5ace94"),
        targets: (8, 8),
        notes: "a window of 50 frames, with 8 targets; 41 of 1120 are outside the window",
    },
    KnownIndex {
        name: "zpressor-dl3dv-16v",
        repository: "ziplab/ZPressor",
        path: "depthsplat/assets/dl3dv_evaluation/dl3dv_ctx_16v_tgt_8v_n50.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("169e3b50a625968fe6014ae691b6ddbe8b4eb20abc1078db39c950d14690e354"),
        content: Sha256Digest::literal("1922a24c1e9b7088faca836a2c2970e6d1a72c7444c37bc39f3475176a89d3d1"),
        targets: (8, 8),
        notes: "a window of 50 frames, with 8 targets; 39 of 1120 are outside the window",
    },
    KnownIndex {
        name: "zpressor-dl3dv-24v",
        repository: "ziplab/ZPressor",
        path: "depthsplat/assets/dl3dv_evaluation/dl3dv_ctx_24v_tgt_8v_n50.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("1e935392a6827b6c2457bde86bd8e8644a2950aded9b91127af48e04defcc6c2"),
        content: Sha256Digest::literal("4f96980983b8983acc4249e2426f98204ab108b0df40899d65b3f7b607787004"),
        targets: (8, 8),
        notes: "a window of 50 frames, with 8 targets; 35 of 1120 are outside the window",
    },
    KnownIndex {
        name: "zpressor-dl3dv-36v",
        repository: "ziplab/ZPressor",
        path: "depthsplat/assets/dl3dv_evaluation/dl3dv_ctx_36v_tgt_8v_n50.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("bf12e8b736bf294aa6fd5d8cd22c400bb4232ca738a5ef28030412dd2b1fd911"),
        content: Sha256Digest::literal("422e4e5bf4a958cb2daa590e98acf46846a2870fa9e0642503c2af0d2b27358b"),
        targets: (8, 8),
        notes: "a window of 50 frames, with 8 targets; 60 of 1120 are outside the window",
    },
    KnownIndex {
        name: "volsplat-re10k-6v",
        repository: "ziplab/VolSplat",
        path: "assets/re10k_evaluation/evaluation_index_re10k.json",
        dataset: "re10k",
        sha256: Sha256Digest::literal("16c77f6531ba7e1324a1922bec3a8223e64edeb7d59cba3f9be25a3b0c596adb"),
        content: Sha256Digest::literal("98f477a7c4d5a302d89262d42741bc90726e38cd3463c749560e1a1fb90c8472"),
        targets: (8, 8),
        notes: "same file name as pixelSplat's, another protocol: 6 views in at most 50 frames, 8 targets",
    },
    KnownIndex {
        name: "volsplat-acid-6v",
        repository: "ziplab/VolSplat",
        path: "assets/acid_evaluation/evaluation_index_acid.json",
        dataset: "acid",
        sha256: Sha256Digest::literal("2ec891f6fb6d9b32d4b4ea36b0711d9271d8ebfb6fe0a107b7276994315b6ed3"),
        content: Sha256Digest::literal("9952a17972684f77b4d980578079afa8efe375c9a4c9e515db0636e9c2b793a9"),
        targets: (8, 8),
        notes: "same file name as pixelSplat's, another protocol: 6 views in at most 50 frames, 8 targets",
    },
    KnownIndex {
        name: "spfsplatv2-dl3dv-2v",
        repository: "ranrhuang/SPFSplatV2",
        path: "assets/evaluation_index_dl3dv.json",
        dataset: "dl3dv",
        sha256: Sha256Digest::literal("bdbc689c195eb1505b5e619eedf44fc6709a11c74356a010b1e8dd470611b3f1"),
        content: Sha256Digest::literal("3bf855df1e64429ff9eb89d9238df7c0d952dca7ae1ec8f0e4280cccb02613c2"),
        targets: (3, 3),
        notes: "windows of 16 to 47 frames; 33 of 420 targets are context frames",
    },
];

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn names_and_hashes_are_unique_and_look_up_their_entry() {
        let names: BTreeSet<_> = KNOWN_INDICES.iter().map(|known| known.name).collect();
        let hashes: BTreeSet<_> = KNOWN_INDICES.iter().flat_map(|known| [known.sha256, known.content]).collect();
        assert_eq!((names.len(), hashes.len()), (KNOWN_INDICES.len(), 2 * KNOWN_INDICES.len()));
        for known in KNOWN_INDICES {
            assert_eq!(KnownIndex::by_sha256(&known.sha256), Some(known));
            assert_eq!(KnownIndex::by_content(&known.content), Some(known));
            assert_eq!(KnownIndex::by_name(known.name), Some(known));
        }
    }

    #[test]
    fn other_files_are_not_recognised() {
        let other = Sha256Digest::of(b"{}");
        assert_eq!(KnownIndex::by_sha256(&other), None);
        assert_eq!(KnownIndex::by_content(&other), None);
        assert_eq!(KnownIndex::by_name("pixelsplat"), None);
    }
}
