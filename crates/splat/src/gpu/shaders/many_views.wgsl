// A batch: image after image, each with a splat of every Gaussian of its scene. `VIEWS` are as many as the adapter's uniform
// buffers hold, up to a limit; see `uniforms.rs`.
@group(0) @binding(0) var<uniform> views: array<View, VIEWS>;

var<private> view: View;

// Number of splats of this dispatch.
fn splats() -> u32 {
    return views[0].part.x;
}

// Makes the view of a splat the current one; returns the splat's Gaussian.
fn enter(splat: u32) -> u32 {
    let each = views[0].batch.x;
    let image = splat / each;
    view = views[image];
    return image / view.batch.w * each + splat % each;
}
