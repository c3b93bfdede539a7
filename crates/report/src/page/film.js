'use strict';
// Plays the films: frames are rows of one image.
(() => {
  for (const film of document.querySelectorAll('figure.film')) {
    const [canvas, sheet, button, range] = ['canvas', 'img', 'button', 'input'].map(tag => film.querySelector(tag));
    let timer = null;
    const draw = () => canvas.getContext('2d').drawImage(sheet, 0, -range.value * canvas.height);
    const play = () => {
      range.value = (Number(range.value) + 1) % (Number(range.max) + 1);
      draw();
    };
    button.addEventListener('click', () => {
      clearInterval(timer);
      timer = timer ? null : setInterval(play, 1000 / film.dataset.speed);
      button.textContent = timer ? 'Pause' : 'Play';
    });
    range.addEventListener('input', draw);
    sheet.decode().then(draw);
  }
})();
