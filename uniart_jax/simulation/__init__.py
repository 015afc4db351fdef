"""Assets in physics engines: loaded, stood up, swept, driven, judged; ``validate.validate`` does it
all."""
