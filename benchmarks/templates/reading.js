// In the studio: say where the page is read, and go back there when it has been loaded again.
if (parent !== window) {
  addEventListener("scroll", () => parent.postMessage({ scroll: scrollY }, "*"));
  addEventListener("message", event => {
    if (event.source === parent && Number.isFinite(event.data?.scroll)) scrollTo(0, event.data.scroll);
  });
}
