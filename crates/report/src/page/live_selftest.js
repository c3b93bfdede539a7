'use strict';
// Draws the live view from its cameras, turned, and coloured by block; sends the pixels to the window around this one.
(async () => {
  const results = {};
  const at = id => document.getElementById(id);
  const base64 = bytes => btoa(bytes.reduce((text, byte) => text + String.fromCharCode(byte), ''));
  try {
    const { live } = at('live-view');
    const canvas = document.querySelector('#live-view canvas');
    const change = (input, value, name) => { input.value = value; input.dispatchEvent(new Event(name)); };
    const take = name => {
      live.resize(1);
      live.draw();
      results[name] = { pixels: base64(live.pixels()), camera_from_world: live.camera_from_world(), size: [canvas.width, canvas.height], width: canvas.clientWidth };
    };
    const drag = (id, x, y, type = 'pointermove') => canvas.dispatchEvent(new PointerEvent(type, { pointerId: id, clientX: x, clientY: y, bubbles: true }));
    results.segments = false;
    live.resize(1);
    live.draw();
    const framed = base64(live.pixels());
    at('live-frusta').click();
    take('first');
    results.segments = framed !== results.first.pixels;
    change(at('live-camera'), 1, 'change');
    take('second');
    change(at('live-camera'), 0, 'change');
    // A finger drags right by a tenth of the canvas, then down by a twentieth.
    drag(7, 100, 100, 'pointerdown');
    drag(7, 100 + canvas.clientWidth / 10, 100);
    take('right');
    drag(7, 100 + canvas.clientWidth / 10, 100 + canvas.clientWidth / 20);
    take('right_and_down');
    drag(7, 0, 0, 'pointerup');
    drag(7, 300, 300);
    take('released');
    canvas.dispatchEvent(new WheelEvent('wheel', { deltaY: -200 }));
    take('nearer');
    at('live-reset').click();
    take('reset');
    change(at('live-tint'), 1, 'input');
    take('by_block');
    change(at('live-tint'), 0, 'input');
    change(at('live-block'), 0, 'input');
    take('before');
    const film = document.querySelector('figure.film');
    const [frame, pixel] = [film.querySelector('input'), film.querySelector('canvas').getContext('2d')];
    for (let tries = 0; tries < 600 && !film.querySelector('img').complete; tries += 1) await new Promise(done => setTimeout(done, 50));
    results.film = [0, 1, 2].map(value => { change(frame, value, 'input'); return [...pixel.getImageData(24, 8, 1, 1).data]; });
    film.querySelector('button').click();
    await new Promise(done => setTimeout(done, 150));
    results.played = film.querySelector('button').textContent + ' ' + frame.value;
    film.querySelector('button').click();
    results.note = at('live-note').textContent;
  } catch (error) {
    results.error = error.stack;
  }
  parent.postMessage(JSON.stringify(results), '*');
})();
