"""Networks in use: samplers of the flows, and the layout network on pictures."""
