"""The web page of `seatrial serve`: campaigns on disk as they are. Commands import none of it, nor NiceGUI."""
