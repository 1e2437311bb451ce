"""How lidarcli shows itself: words of records, text on a terminal, colours."""
