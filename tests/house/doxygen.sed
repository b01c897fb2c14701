# In a comment an element of MJCF or HTML is text.
/^ *\/\/\//s,<([A-Za-z/]),\\<\1,g
