"""What a stranger must know to talk to crossfix: messages, keys, codec, bus and recording."""
