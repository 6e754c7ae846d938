"""Charts as pure functions: rows and a theme in, a plotly Figure out. No database, no request, no clock.

Rows hold seconds and metres; charts show milliseconds a frame and centimetres. An empty list gives a
figure without traces, never an error. Nothing here needs eval in the browser (no scattergl, no
parcoords), and every text that a client sent is escaped.
"""
