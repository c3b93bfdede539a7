'use strict';
// Sends what the page shows of trials that all failed, whose renders have the wrong size, to the window around it.
(async () => {
  const all = query => [...document.querySelectorAll(query)];
  for (let tries = 0; tries < 200 && !all('.maps p').length; tries += 1) await new Promise(done => setTimeout(done, 50));
  const marks = all('#list tr').map(row => row.lastElementChild);
  parent.postMessage(JSON.stringify({
    marks: marks.map(mark => mark.textContent),
    reasons: marks.map(mark => mark.title),
    maps: all('.maps p').map(map => map.textContent),
    canvases: all('.maps canvas').length,
    sliders: all('.slider').length,
  }), '*');
})();
