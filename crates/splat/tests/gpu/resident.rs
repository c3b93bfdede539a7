use atsplat_numeric::Tolerance;
use atsplat_splat::gpu::{
    GpuError, GpuGaussians, GpuImageGradients, GpuOptions, GpuOverrides, GpuPart, GpuRenderer, GpuStripGradients,
};
use atsplat_splat::{Exposure, Gaussians, ImageGradients, RenderOptions, Renderer, SplatError, StoppedGradients};

use crate::scenes::{
    as_gradients, beside, cloud, everything, external_device, filtered, gpu, image_gradients, narrow, on_device,
    overriding, view,
};

/// Results on the device equal those that pass through the host.
#[test]
fn resident_results_equal_host_results() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(700, 1, 19), view(53, 41));
    let resident = gpu.upload(&gaussians).unwrap();
    assert_eq!((resident.len(), resident.sh_degree(), resident.is_empty()), (700, 1, false));
    let rendering = gpu.render_resident(&resident, &view, &everything()).unwrap();
    let through_host = gpu.render(&gaussians, &view, &everything()).unwrap();
    assert!(gpu.read(&rendering).unwrap() == through_host);

    let images = narrow(&image_gradients(&view));
    let strips = as_gradients(&rendering.unsettled().strips);
    let gradients = gpu.backward_resident(&resident, &view, &everything(), &strips).unwrap();
    let by_image = ImageGradients {
        rgb: through_host.rgb,
        alpha: Some(through_host.alpha),
        depth: through_host.depth,
        scalar: through_host.scalar,
    };
    let expected = gpu.backward(&gaussians, &view, &everything(), &by_image).unwrap();
    assert!(gpu.read_gradients(&gradients, &gaussians).unwrap() == expected);
    assert!(gpu.backward(&gaussians, &view, &everything(), &images).unwrap() != expected);
}

#[test]
fn accepts_buffers_and_devices_of_the_caller() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(300, 1, 19), view(30, 20));
    let uploaded = gpu.upload(&gaussians).unwrap();
    let mut external = beside(&gpu, GpuOptions::default());
    let wrapped = GpuGaussians::from_parts(uploaded.parts().to_vec(), 1).unwrap();
    let rendering = external.render_resident(&wrapped, &view, &everything()).unwrap();
    assert!(external.read(&rendering).unwrap() == gpu.render(&gaussians, &view, &everything()).unwrap());

    let mut short = uploaded.parts().to_vec();
    short[0].count = 100_000;
    assert!(matches!(GpuGaussians::from_parts(short, 1), Err(SplatError::Length { .. })));
    let five = GpuGaussians::from_parts(uploaded.parts().to_vec(), 5);
    assert!(matches!(five, Err(SplatError::ShDegree { found: 5 })));
}

#[test]
fn reports_stage_timings() {
    let Some(mut gpu) = gpu() else { return };
    gpu.render(&cloud(300, 1, 19), &view(30, 20), &everything()).unwrap();
    let stages = gpu.stages();
    assert!(!stages.is_empty() && stages.iter().all(|stage| stage.secs >= 0.0 && stage.secs < 60.0), "{stages:?}");
    assert!(gpu.name().starts_with("gpu, ") && gpu.name().contains(gpu.adapter()));
}

/// One gradient that is not a number, of the scalar's image: here only the gradient of the Gaussian's scalar depends on it.
#[test]
fn a_gradient_that_is_not_a_number_is_read_as_such() {
    let Some(mut gpu) = gpu() else { return };
    let (mut parts, view) = (cloud(1, 0, 19).into_parts(), view(21, 15));
    (parts.means, parts.log_scales, parts.opacity_logits) = (vec![[0.0, 0.0, 3.0]], vec![[0.0; 3]], vec![1.0]);
    let gaussians = Gaussians::new(parts).unwrap();
    let gradients = StoppedGradients { scalar_stops: true, directions_stop: false };
    let options = RenderOptions { gradients, ..everything() };
    let resident = gpu.upload(&gaussians).unwrap();
    let mut scalar = vec![0.25; view.pixels()];
    for (value, not_finite) in [(0.75, 0), (f32::NAN, 1)] {
        scalar[7 * 21 + 10] = value;
        let images = ImageGradients {
            rgb: vec![[1.0, -0.5, 0.25]; view.pixels()],
            alpha: Some(vec![0.5; view.pixels()]),
            depth: Some(vec![0.5; view.pixels()]),
            scalar: Some(scalar.clone()),
        };
        let images = on_device(&gpu, &[images]);
        let gradients = gpu.backward_resident(&resident, &view, &options, &images).unwrap();
        let found = gpu.read_gradients(&gradients, &gaussians).unwrap();
        assert_eq!(found.non_finite(), not_finite, "{value}: {found:?}");
        assert!(not_finite == 0 || found.scalars[0].is_nan(), "{found:?}");
    }
}

/// [`Renderer::backward`] passes gradients through the exposure on the host, these are passed on the device.
#[test]
fn gradients_pass_the_exposure_on_the_device() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(400, 1, 29), view(30, 20));
    let matrix = [[1.8, -0.4, 0.1], [0.2, 0.7, -0.3], [-0.5, 0.3, 2.5]];
    let options = RenderOptions { exposure: Some(Exposure { matrix, offset: [-0.2, 0.1, 0.05] }), ..everything() };
    let images = narrow(&image_gradients(&view));
    let expected = gpu.backward(&gaussians, &view, &options, &images).unwrap();
    let images = on_device(&gpu, &[images]);
    let resident = gpu.upload(&gaussians).unwrap();
    let gradients = gpu.backward_resident(&resident, &view, &options, &images).unwrap();
    let found = gpu.read_gradients(&gradients, &gaussians).unwrap().map(f64::from);
    for ((name, found), (_, expected)) in found.fields().into_iter().zip(expected.map(f64::from).fields()) {
        assert!(expected.iter().any(|value| value.abs() > 0.0), "{name}");
        let within = Tolerance::of_largest(1e-5, expected.iter().copied());
        within.assert(found.iter().copied(), expected.iter().copied(), name.name());
    }
}

/// Only some strips have gradients of depth and scalar.
#[test]
fn splitting_into_parts_and_strips_changes_nothing() {
    let small = GpuOverrides { binding_limit: 128 << 10, ..GpuOverrides::default() };
    let Some(mut gpu) = gpu() else { return };
    let mut limited = beside(&gpu, overriding(small));
    let (gaussians, view) = (cloud(2000, 3, 19), view(97, 71));
    let resident = limited.upload(&gaussians).unwrap();
    let rendering = limited.render_resident(&resident, &view, &everything()).unwrap();
    let image_strips = &limited.settle(&rendering).unwrap().result.strips;
    assert!(resident.parts().len() > 2 && image_strips.len() > 2);
    let image = gpu.render(&gaussians, &view, &everything()).unwrap();
    assert!(limited.read(&rendering).unwrap() == image);

    let has_extras = |strip: usize| strip % 2 == 1;
    let strips = image_strips.iter().enumerate().map(|(n, strip)| GpuStripGradients {
        colours: strip.colours.clone(),
        extras: strip.extras.clone().filter(|_| has_extras(n)),
    });
    let strips = GpuImageGradients { strips: strips.collect() };
    let gradients = limited.backward_resident(&resident, &view, &everything(), &strips).unwrap();
    let mut by_image =
        ImageGradients { rgb: image.rgb, alpha: Some(image.alpha), depth: image.depth, scalar: image.scalar };
    for (n, strip) in image_strips.iter().enumerate().filter(|(n, _)| !has_extras(*n)) {
        let [from, past] = [strip.first_row, strip.first_row + strip.rows].map(|row| (row * view.size.width) as usize);
        for values in by_image.depth.iter_mut().chain(&mut by_image.scalar) {
            values[from..past].fill(0.0);
        }
        assert!(n % 2 == 0);
    }
    let expected = gpu.backward(&gaussians, &view, &everything(), &by_image).unwrap();
    assert!(limited.read_gradients(&gradients, &gaussians).unwrap() == expected);
}

#[test]
fn rejects_reading_gradients_for_other_gaussians() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(100, 1, 19), view(30, 20));
    let resident = gpu.upload(&gaussians).unwrap();
    let strips = constant(&gpu, 30 * 20, wgpu::BufferUsages::STORAGE);
    let gradients = gpu.backward_resident(&resident, &view, &everything(), &strips).unwrap();
    let mut without_scalars = gaussians.parts().clone();
    without_scalars.scalars = None;
    let others = [cloud(101, 1, 19), cloud(99, 1, 19), cloud(100, 2, 19), Gaussians::new(without_scalars).unwrap()];
    for other in &others {
        let outcome = gpu.read_gradients(&gradients, other);
        assert!(matches!(outcome, Err(SplatError::Length { .. })), "{outcome:?}");
    }
    gpu.read_gradients(&gradients, &gaussians).unwrap();
}

/// A single strip of zeros.
fn constant(gpu: &GpuRenderer, pixels: u64, usage: wgpu::BufferUsages) -> GpuImageGradients {
    let descriptor = wgpu::BufferDescriptor { label: None, size: 16 * pixels, usage, mapped_at_creation: false };
    let colours = gpu.device().create_buffer(&descriptor);
    GpuImageGradients { strips: vec![GpuStripGradients { colours, extras: None }] }
}

#[test]
fn rejects_gradients_of_the_wrong_shape() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(100, 1, 19), view(30, 20));
    let resident = gpu.upload(&gaussians).unwrap();
    let backward = |images: &GpuImageGradients, gpu: &mut GpuRenderer| {
        gpu.backward_resident(&resident, &view, &everything(), images).map(|_| ())
    };
    let storage = wgpu::BufferUsages::STORAGE;
    let short = constant(&gpu, 30 * 20 - 1, storage);
    let mut short_extras = constant(&gpu, 30 * 20, storage);
    short_extras.strips[0].extras = Some(short.strips[0].colours.clone());
    let mut too_many = constant(&gpu, 30 * 20, storage);
    too_many.strips.push(too_many.strips[0].clone());
    for wrong in [short, short_extras, too_many, GpuImageGradients { strips: Vec::new() }] {
        let outcome = backward(&wrong, &mut gpu);
        assert!(matches!(outcome, Err(SplatError::Length { .. })), "{outcome:?}");
    }
    let unseen = constant(&gpu, 30 * 20, wgpu::BufferUsages::COPY_DST);
    let outcome = backward(&unseen, &mut gpu);
    assert!(
        matches!(&outcome, Err(SplatError::Gpu(GpuError::Rejected { reason, .. }))
            if reason.contains("STORAGE, found")),
        "{outcome:?}"
    );
    let right = constant(&gpu, 30 * 20, storage);
    backward(&right, &mut gpu).unwrap();
}

/// Buffers that are longer than a kernel may see and end within a word; of another device; that no kernel may see.
#[test]
fn buffers_of_others_are_taken_or_rejected_in_words() {
    let lower = |limits: &mut wgpu::Limits| limits.max_storage_buffer_binding_size = 128 << 10;
    let (Some(mut gpu), Some((device, queue))) = (gpu(), external_device(lower)) else { return };
    let (gaussians, view) = (cloud(300, 1, 19), view(30, 20));
    let mut external = GpuRenderer::with_device(device.clone(), queue.clone(), GpuOptions::default()).unwrap();
    let (other_device, other_queue) = external_device(lower).unwrap();
    let mut unrelated = GpuRenderer::with_device(other_device, other_queue, GpuOptions::default()).unwrap();
    let put = |values: &[f32], size: u64, usage: wgpu::BufferUsages| {
        let usage = usage | wgpu::BufferUsages::COPY_DST;
        let buffer =
            device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        queue.write_buffer(&buffer, 0, &bytes);
        buffer
    };
    let part = |size: u64, usage| {
        let of = gaussians.parts();
        GpuPart {
            count: 300,
            means: put(of.means.as_flattened(), size, usage),
            quaternions: put(of.quaternions.as_flattened(), size, usage),
            log_scales: put(of.log_scales.as_flattened(), size, usage),
            opacity_logits: put(&of.opacity_logits, size, usage),
            sh: put(of.sh.as_flattened(), size, usage),
            scalars: of.scalars.as_ref().map(|scalars| put(scalars, size, usage)),
            filter_3d: None,
        }
    };
    let expected = gpu.render(&gaussians, &view, &everything()).unwrap();
    for size in [(512 << 10) + 2, 14_402] {
        let long = GpuGaussians::from_parts(vec![part(size, wgpu::BufferUsages::STORAGE)], 1).unwrap();
        let rendering = external.render_resident(&long, &view, &everything()).unwrap();
        assert!(external.read(&rendering).unwrap() == expected, "{size}");
        let outcome = unrelated.render_resident(&long, &view, &everything());
        assert!(matches!(outcome, Err(SplatError::Gpu(GpuError::Rejected { .. }))), "{outcome:?}");
    }
    let unseen = GpuGaussians::from_parts(vec![part(14_400, wgpu::BufferUsages::COPY_SRC)], 1).unwrap();
    let outcome = external.render_resident(&unseen, &view, &everything());
    assert!(
        matches!(&outcome, Err(SplatError::Gpu(GpuError::Rejected { reason, .. }))
            if reason.contains("STORAGE, found")),
        "{outcome:?}"
    );
    let mut many = part(512 << 10, wgpu::BufferUsages::STORAGE);
    many.count = 12_000;
    let many = GpuGaussians::from_parts(vec![many], 0).unwrap();
    let outcome = external.render_resident(&many, &view, &everything());
    assert!(matches!(outcome, Err(SplatError::Gpu(GpuError::TooLarge { .. }))), "{outcome:?}");
}

/// A part without scalars or filters is as one whose are 0.
#[test]
fn some_parts_have_scalars_and_some_have_filters() {
    let Some(mut gpu) = gpu() else { return };
    let (first, second) = (filtered(&cloud(200, 1, 5)), cloud(150, 1, 6));
    let view = view(30, 20);
    let [mut bare, mut one] = [first.parts().clone(), first.parts().clone()];
    bare.scalars = None;
    let parts = [bare, second.parts().clone()].map(|parts| gpu.upload(&Gaussians::new(parts).unwrap()).unwrap());
    let both = GpuGaussians::from_parts(parts.iter().flat_map(|parts| parts.parts().to_vec()).collect(), 1).unwrap();
    let rendering = gpu.render_resident(&both, &view, &everything()).unwrap();

    let zeros = |count: usize| vec![0.0; count];
    let other = second.parts().clone();
    one.means.extend(other.means);
    one.quaternions.extend(other.quaternions);
    one.log_scales.extend(other.log_scales);
    one.opacity_logits.extend(other.opacity_logits);
    one.sh.extend(other.sh);
    one.scalars = Some([zeros(200), other.scalars.unwrap()].concat());
    one.filter_3d = Some([one.filter_3d.unwrap(), zeros(150)].concat());
    let one = Gaussians::new(one).unwrap();
    assert!(gpu.read(&rendering).unwrap() == gpu.render(&one, &view, &everything()).unwrap());
    let images = constant(&gpu, 30 * 20, wgpu::BufferUsages::STORAGE);
    let gradients = gpu.backward_resident(&both, &view, &everything(), &images).unwrap();
    let parts = &gradients.unsettled().parts;
    assert!(parts[0].scalars.is_none() && parts[1].scalars.is_some());
}

/// What is on the device counts.
#[test]
fn resident_gaussians_count_towards_the_limit() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(2000, 4, 19), view(30, 20));
    let resident = gpu.upload(&gaussians).unwrap();
    let limited = |limit: u64| beside(&gpu, GpuOptions { memory_limit: limit, ..GpuOptions::default() });
    let outcome = limited(600_000).render_resident(&resident, &view, &everything());
    assert!(matches!(outcome, Err(SplatError::Memory { .. })), "{outcome:?}");
    limited(1_600_000).render_resident(&resident, &view, &everything()).unwrap();
}
