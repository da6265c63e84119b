"""The web page of `seatrial serve`: campaigns on disk as they are. NiceGUI is imported in `server`, `frame` and `pages` only."""
