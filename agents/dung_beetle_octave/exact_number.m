function number = exact_number(line, key)
  % Return the number behind a key of a JSON object as it was written, to the bit.
  %
  % jsondecode may be wrong in the last bit of a number with more than 15 digits.
  text = regexp(line, ['"' key '":\s*([-+.0-9eE]+)'], 'tokens', 'once');
  number = str2double(text{1});
end
