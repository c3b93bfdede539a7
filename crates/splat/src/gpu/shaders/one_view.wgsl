// All splats are seen by the same camera, or the kernel does not ask which.
@group(0) @binding(0) var<uniform> view: View;

// Number of splats of this dispatch.
fn splats() -> u32 {
    return view.part.x;
}

// The Gaussian of a splat.
fn enter(splat: u32) -> u32 {
    return splat;
}
