"""A live web page and a Foxglove server that show vehicles and cannot command them."""
