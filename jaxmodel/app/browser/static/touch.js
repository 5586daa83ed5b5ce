// A click before the page is in touch with its server, or while it is not, would be lost: none can be made then.

setInterval(() => {
  document.documentElement.classList.toggle("in-touch", Boolean(window.did_handshake && window.socket?.connected));
}, 50);
