use super::*;

fn all() -> Vec<ModelConfig> {
    ModelConfig::names().map(|name| ModelConfig::named(name).unwrap()).collect()
}

/// `paper-re10k` with one piece of text replaced.
fn changed(from: &str, to: &str) -> Result<ModelConfig, ModelError> {
    let text = ModelConfig::text_of("paper-re10k").unwrap();
    assert!(text.contains(from), "{from:?} was not found");
    ModelConfig::from_toml(&text.replacen(from, to, 1))
}

#[test]
fn every_configuration_has_its_files_name_and_lists_inferred_values() {
    for (name, config) in ModelConfig::names().zip(all()) {
        assert_eq!(config.name, name);
        assert!(!config.title.is_empty(), "{name}");
        let inferred = config.inferred.join("\n");
        let of_all =
            ["ray of an anchor", "nearest neighbours", "upsampled", "rounded up", "equal scores", "gives no degree"];
        let of_dino = config.backbone.is_frozen().then_some("after the last norm");
        for value in of_all.into_iter().chain(of_dino) {
            assert!(inferred.contains(value), "{name}: {value}");
        }
    }
}

#[test]
fn the_papers_configurations_have_its_dimensions() {
    let config = ModelConfig::named("paper-re10k").unwrap();
    assert_eq!((config.transformer.dim, config.transformer.heads(), config.transformer.hidden_dim()), (768, 12, 3072));
    assert_eq!((config.coarse.layers, config.fine.layers), (12, 2));
    let layers: Vec<usize> = config.decoder.blocks.iter().map(|block| block.layers).collect();
    assert_eq!(layers, [1, 1, 2, 2]);
    assert_eq!(config.coarse_grid(config.resolution).unwrap(), Grid { rows: 16, columns: 16 });
    assert_eq!(config.fine_grid(config.resolution).unwrap(), Grid { rows: 32, columns: 32 });
    let high_resolution = ModelConfig::named("paper-dl3dv-hr").unwrap();
    assert_eq!(high_resolution.coarse_grid(high_resolution.resolution).unwrap(), Grid { rows: 16, columns: 30 });
    assert_eq!(high_resolution.fine_grid(high_resolution.resolution).unwrap(), Grid { rows: 64, columns: 120 });
}

#[test]
fn small_models_keep_the_papers_geometry() {
    let paper = ModelConfig::named("paper-re10k").unwrap();
    for name in ["mini", "nano"] {
        let small = ModelConfig::named(name).unwrap();
        assert_eq!((small.coarse.patch_size, small.fine.patch_size), (16, 8));
        assert_eq!((&small.decoder, &small.expansion), (&paper.decoder, &paper.expansion), "{name}");
        assert_eq!((&small.head, &small.anchors), (&paper.head, &paper.anchors), "{name}");
    }
}

/// Their titles and other notes state width, patches and backbone alone.
#[test]
fn notes_of_small_models_state_which_layers_they_lack() {
    let paper = ModelConfig::named("paper-re10k").unwrap();
    for name in ["mini", "micro", "nano"] {
        let small = ModelConfig::named(name).unwrap();
        let (global, per_view) = (small.coarse.layers, small.fine.layers);
        let mut expected = format!("It has {global} global self-attention layers instead of {}", paper.coarse.layers);
        if per_view != paper.fine.layers {
            let more = format!(", and {per_view} per-view layer of the fine branch instead of {}", paper.fine.layers);
            expected.push_str(&more);
        }
        assert!(small.notes.contains(&format!("{expected}.")), "{name}: {expected}");
    }
}

#[test]
fn toml_round_trip_keeps_value_and_hash() {
    for config in all() {
        let read = ModelConfig::from_toml(&config.to_toml().unwrap()).unwrap();
        assert_eq!(read, config);
        assert_eq!(read.hash().unwrap(), config.hash().unwrap());
    }
}

#[test]
fn hashes_ignore_prose_and_nothing_else() {
    let config = ModelConfig::named("nano").unwrap();
    let mut reworded = config.clone();
    reworded.name.push('x');
    reworded.inferred.clear();
    assert_eq!(reworded.hash().unwrap(), config.hash().unwrap());
    let mut other = config.clone();
    other.head.sh_degree = 1;
    assert_ne!(other.hash().unwrap(), config.hash().unwrap());
    assert_ne!(config.with_expansion_in_first(0).hash().unwrap(), config.hash().unwrap());
}

#[test]
fn the_head_frame_is_part_of_the_hash_and_the_default_is_not_written() {
    let world = ModelConfig::named("nano").unwrap();
    assert!(!world.to_toml().unwrap().contains("frame ="));
    let mut patch = world.clone();
    patch.head.frame = HeadFrame::Patch;
    assert_ne!(patch.hash().unwrap(), world.hash().unwrap());
    assert_eq!(ModelConfig::from_toml(&patch.to_toml().unwrap()).unwrap(), patch);
    let mut few = patch.clone();
    few.head = patch.head.keeping_first(4);
    assert!(few.to_toml().unwrap().contains("patch-cells = 16") && !patch.to_toml().unwrap().contains("patch-cells"));
    assert_eq!(ModelConfig::from_toml(&few.to_toml().unwrap()).unwrap(), few);
}

#[test]
fn cells_are_as_square_as_possible_and_never_higher_than_wide() {
    for (count, rows, columns) in [(1, 1, 1), (3, 1, 3), (4, 2, 2), (8, 2, 4), (12, 3, 4), (16, 4, 4), (32, 4, 8)] {
        let head = HeadConfig { gaussians_per_token: count, ..ModelConfig::named("micro").unwrap().head };
        assert_eq!(head.cells(), Grid { rows, columns }, "{count}");
    }
    let head = HeadConfig { gaussians_per_token: 12, ..ModelConfig::named("micro").unwrap().head };
    let few = head.keeping_first(8);
    assert_eq!((few.gaussians_per_token, few.cells()), (8, Grid { rows: 3, columns: 4 }), "not 2 rows");
    assert_eq!(few.keeping_first(2).cells(), head.cells(), "of the first 8 of 12");
    assert_eq!(few.keeping_first(12), head);
    assert_eq!(few.keeping_first(32).cells(), Grid { rows: 4, columns: 8 });
}

#[test]
fn ratios_replace_those_of_the_blocks_that_expand() {
    let config = ModelConfig::named("paper-re10k").unwrap();
    let ratios = |shares: &[f64]| shares.iter().map(|&share| SelectionRatio::new(share).unwrap()).collect::<Vec<_>>();
    assert_eq!(config.with_ratios(&ratios(&[0.5, 0.5, 0.25])).unwrap(), config);
    let most = |config: &ModelConfig| crate::budget::budget(config, 2, config.resolution).unwrap().max.final_tokens;
    assert_eq!(most(&config.with_ratios(&ratios(&[1.0, 0.5, 0.0])).unwrap()), 512 * 3);
    for wrong in [&[][..], &[0.5], &[0.5; 4]] {
        let error = config.with_ratios(&ratios(wrong)).unwrap_err().to_string();
        assert!(error.contains("expected 3 ratios, one for each block that expands"), "{error}");
    }
}

#[test]
fn every_variant_can_be_configured() {
    for (from, to) in [
        ("design = { kind = \"patch-depth\" }", "design = { kind = \"patch-depth\" }"),
        ("size = \"base\"", "size = \"small\""),
        ("size = \"base\"", "size = \"large\""),
        ("registers = false", "registers = true"),
        ("kind = \"uncertainty\"", "kind = \"random\", seed = 7"),
        ("kind = \"uncertainty\"", "kind = \"farthest-point\""),
        ("kind = \"uncertainty\"", "kind = \"straight-through\""),
        ("expansion = { ratio = 0.5 }", "expansion = { threshold = 0.05 }"),
        ("expansion = { ratio = 0.5 }\n", ""),
        ("expansion = { ratio = 0.5 }", "expand = false\nexpansion = { ratio = 0.5 }"),
        ("kind = \"log-sigmoid\", near = 0.1, far = 500.0, shift = 0.0", "kind = \"exp\", shift = 1.0"),
        ("kind = \"log-sigmoid\"", "kind = \"sigmoid\""),
        ("kind = \"log-sigmoid\"", "kind = \"inverse-sigmoid\""),
        ("kind = \"linear\"", "kind = \"inverse-log\""),
        ("kind = \"exp-clamped\", shift = -6.9, max = -1.2", "kind = \"softplus\", shift = 0.0, gain = 0.01"),
        ("\"normalize\"", "\"normalize-from-identity\""),
        ("kind = \"rms\", eps = 1e-5", "kind = \"none\""),
        ("kind = \"point-net\", neighbours = 16", "kind = \"none\""),
        ("upsampling = \"bilinear\"", "upsampling = \"nearest\""),
        ("gaussians-per-token = 16", "gaussians-per-token = 64"),
        ("gaussians-per-token = 16", "gaussians-per-token = 4\npatch-cells = 16"),
        ("sh-degree = 0", "sh-degree = 4"),
        ("sh-degree = 0", "sh-degree = 0\nframe = \"patch\""),
    ] {
        changed(from, to).unwrap_or_else(|error| panic!("{to}: {error}"));
    }
    let without_anchors = |design: &str| {
        let text = ModelConfig::text_of("paper-re10k").unwrap();
        let text = text.replace("kind = \"patch-depth\"", design);
        ModelConfig::from_toml(&text.replace("kind = \"point-net\", neighbours = 16", "kind = \"none\""))
    };
    for design in ["kind = \"ray-depth\"", "kind = \"learnable-tokens\", tokens = 512", "kind = \"direct-xyz\""] {
        without_anchors(design).unwrap_or_else(|error| panic!("{design}: {error}"));
    }
}

#[test]
fn contradictions_name_their_field() {
    for (from, to, expected) in [
        ("name = \"paper-re10k\"", "name = \"Paper\"", "field name: expected lower-case"),
        ("head-dim = 64", "head-dim = 63", "field transformer.head-dim: expected a divisor of transformer.dim"),
        ("head-dim = 64", "head-dim = 0", "field transformer.head-dim: expected 1 to 768, found 0"),
        ("norm-eps = 1e-5", "norm-eps = nan", "field transformer.norm-eps: expected a positive number"),
        (
            "resolution = [256, 256]",
            "resolution = [256, 250]",
            "coarse branch, image size: expected a height and width",
        ),
        ("resolution = [256, 256]", "resolution = [256, 0]", "field resolution: expected 1 to 16384, found 0"),
        (
            "resolution = [256, 256]",
            "resolution = [1600000, 256]",
            "field resolution: expected 1 to 16384, found 1600000",
        ),
        ("patch-size = 8", "patch-size = 3", "field fine: expected patches that divide the coarse branch's"),
        ("kind = \"patch-depth\"", "kind = \"direct-xyz\"", "field anchors.context: expected none"),
        ("near = 0.1", "near = 600.0", "field anchors.depth: expected near < far, found 600 and 500"),
        ("near = 0.1", "near = 0.0", "field anchors.depth.near: expected a positive number"),
        ("children = 2", "children = 0", "field expansion.children: expected 1 to 64, found 0"),
        ("gaussians-per-token = 16", "gaussians-per-token = 0", "field head.gaussians-per-token"),
        ("sh-degree = 0", "sh-degree = 0\npatch-cells = 12", "field head.patch-cells: expected 16 to 4096, found 12"),
        ("sh-degree = 0", "sh-degree = 5", "field head.sh-degree: expected 0 to 4, found 5"),
        ("gain = 1.0", "gain = inf", "field head.offset.gain"),
        ("shift = -2.0", "shift = nan", "field head.opacity.shift"),
        ("sh-degree = 0", "sh-degree = 0\nframe = \"camera\"", "unknown variant `camera`"),
    ] {
        let error = changed(from, to).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let text =
        ModelConfig::text_of("paper-re10k").unwrap().replace("kind = \"uncertainty\"", "kind = \"random\", seed = 1");
    let error = ModelConfig::from_toml(&text.replacen("ratio = 0.5", "threshold = 0.1", 1)).unwrap_err().to_string();
    assert!(error.contains("field decoder.blocks[1].expansion: expected a ratio"), "{error}");
    let text =
        ModelConfig::text_of("paper-re10k").unwrap().replace("kind = \"uncertainty\"", "kind = \"farthest-point\"");
    let text = text.replace("kind = \"patch-depth\"", "kind = \"direct-xyz\"");
    let error = ModelConfig::from_toml(&text.replace("kind = \"point-net\", neighbours = 16", "kind = \"none\""));
    assert!(error.unwrap_err().to_string().contains("field expansion.selection"));
    let text = ModelConfig::text_of("micro").unwrap().replace("kind = \"patch-depth\"", "kind = \"ray-depth\"");
    let error = ModelConfig::from_toml(&text.replace("kind = \"point-net\", neighbours = 16", "kind = \"none\""));
    assert!(error.unwrap_err().to_string().contains("field head.frame: expected world"));
}

#[test]
fn malformed_text_names_line_and_column() {
    for (from, to, expected) in [
        ("dim = 768", "dim = \"wide\"", "expected a whole number of at least 0, found \"wide\""),
        ("dim = 768", "dimension = 768", "unknown field `dimension`"),
        ("kind = \"dino-v2\"", "kind = \"dino-v3\"", "unknown variant `dino-v3`"),
        ("registers = false", "registers = false\nlayer = 3", "unknown field `layer`"),
        ("ratio = 0.5", "ratio = 1.5", "a ratio from 0 to 1"),
        ("ratio = 0.5", "ratio = 0.5, threshold = 1.0", "line "),
        ("kind = \"patch-depth\"", "kind = \"patch-depth\", tokens = 3", "unknown field `tokens`"),
        ("[backbone]", "[backbone", "line "),
    ] {
        let error = changed(from, to).unwrap_err().to_string();
        assert!(error.starts_with("model configuration: line ") && error.contains(expected), "{error}");
    }
}

#[test]
fn names_and_paths_are_distinguished() {
    let error = ModelConfig::resolve("paper").unwrap_err().to_string();
    assert!(error.contains("paper-re10k") && error.contains("\"paper\""), "{error}");
    let error = ModelConfig::resolve("no/such.toml").unwrap_err().to_string();
    assert!(error.starts_with("reading a model configuration: ") && error.ends_with("(no/such.toml)"), "{error}");
}

#[test]
fn images_are_large_if_the_weights_see_their_half_as_it_is() {
    let config = ModelConfig::named("paper-dl3dv").unwrap();
    let size = ImageSize::new;
    for (image, trained_at, expected) in [
        (size(512, 960), size(256, 480), true),
        (size(512, 960), size(256, 448), true),
        (size(512, 960), size(512, 960), false),
        (size(512, 960), size(224, 448), false),
        (size(256, 448), size(128, 224), false),
    ] {
        assert_eq!(config.has_high_resolution(image, trained_at), expected, "{image} by weights of {trained_at}");
    }
}

#[test]
fn the_high_resolution_setting_equals_its_configuration() {
    let [normal, high] = ["paper-dl3dv", "paper-dl3dv-hr"].map(|name| ModelConfig::named(name).unwrap());
    let setting = |config: &ModelConfig| config.for_high_resolution().unwrap();
    assert_eq!(setting(&normal).unwrap().hash().unwrap(), high.hash().unwrap());
    assert_eq!(setting(&high).as_ref(), Some(&high));
    // Patches of the coarse branch divide images of twice the resolution, whatever it is.
    let mut nano = ModelConfig::named("nano").unwrap();
    nano.resolution = ImageSize::new(112, 144);
    assert_eq!(setting(&nano).unwrap().resolution, ImageSize::new(224, 288));
    // At a quarter of their size, the coarse branch sees large images smaller than the setting would show them.
    nano.coarse.image_downscale = 4;
    nano.resolution = ImageSize::new(128, 192);
    nano.validate().unwrap();
    assert_eq!(setting(&nano), None);
}

#[test]
fn a_setting_for_large_images_that_cannot_be_made_is_an_error() {
    let mut nano = ModelConfig::named("nano").unwrap();
    nano.resolution = ImageSize::new(8192, 16);
    assert_eq!(nano.for_high_resolution().unwrap().unwrap().resolution, ImageSize::new(16_384, 32));
    nano.resolution = ImageSize::new(8208, 16);
    nano.validate().unwrap();
    let error = nano.for_high_resolution().unwrap_err().to_string();
    let expected = "setting for large images: model configuration: field resolution: expected 1 to 16384, found 16416";
    assert_eq!(error, expected);
}
